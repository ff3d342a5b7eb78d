#pragma once

/// @file
/// The reference renderer's geometry, in double precision and from first principles: a pixel's
/// ray meets a surfel's plane. Only compat_rules.h and the tile lists that may miss pixels are
/// shared with the fast renderer.

#include <cstddef>
#include <vector>

#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/frames.h"
#include "renderer/raster/compat_rules.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer::internal {

/// A surfel that is drawn, in the camera frame.
struct ReferenceSurfel {
  std::size_t index;
  float depth_key;
  glm::dvec3 centre_m, u_m, v_m;  ///< u, v: tangents times scales.
  glm::dvec3 normal_world;        ///< Towards the camera.
  glm::dvec3 colour;
  double opacity, k2;
  glm::dvec2 low_pass_px;      ///< Centre of the low pass.
  double z_min_m, z_max_m;     ///< Depth range of the visible disc; kExact.
  bool edge_on;                ///< Drawn by the low pass only; kExact.
  TileRectangle tiles;         ///< That look at it: kInria, kGsplat and kAabb.
  ScreenEllipse<double> rows;  ///< Whose tile rows look at it: kPaper.
};

struct Meeting {
  double alpha = 0.0;  ///< 0: the surfel is not hit.
  double depth_m = 0.0;
};

/// The surfels of one view.
class ReferenceSurfels {
 public:
  ReferenceSurfels(const SurfelCloud& cloud, const RenderOptions& options,
                   const core::CameraPose& T_world_camera,
                   const core::CameraIntrinsics& intrinsics);

  /// In order of centre depth, ties by index.
  [[nodiscard]] const std::vector<ReferenceSurfel>& sorted() const { return sorted_; }

  /// Can a tile's list lack a surfel that one of its pixels would meet?
  [[nodiscard]] bool lists_may_miss() const;
  /// Is the surfel in the tile's list? True if lists miss nothing.
  [[nodiscard]] bool listed(const ReferenceSurfel& surfel, int tile_x, int tile_y) const;

  /// @param px  Image position; pixel centres are at + 0.5.
  [[nodiscard]] Meeting meet(const ReferenceSurfel& surfel, const glm::dvec2& px) const;

 private:
  [[nodiscard]] ReferenceSurfel in_camera(std::size_t i) const;
  /// @return  False if the program drops the surfel.
  bool apply_compat(ReferenceSurfel& surfel) const;
  void apply_exact(ReferenceSurfel& surfel) const;
  [[nodiscard]] glm::dvec3 colour_of(std::size_t i, const glm::dvec3& eye_m) const;
  /// (u, v, 1) -> (x z, y z, z) in pixels and metres.
  [[nodiscard]] glm::dmat3 homography(const ReferenceSurfel& surfel) const;
  [[nodiscard]] Meeting meet_exact(const ReferenceSurfel& surfel, const glm::dvec2& px) const;
  [[nodiscard]] Meeting meet_compat(const ReferenceSurfel& surfel, const glm::dvec2& px) const;

  const SurfelCloud& cloud_;
  RenderOptions options_;
  core::CameraPose T_world_camera_;
  core::CameraIntrinsics intrinsics_;
  int tiles_x_, tiles_y_;
  std::vector<ReferenceSurfel> sorted_;
};

}  // namespace segsim::renderer::internal
