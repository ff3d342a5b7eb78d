#pragma once

/// @file
/// Which surfaces of a recording are its floor, walls and ceiling, by shape alone: what a view
/// shows of them needs no segmenter.
///
///     floor     level, facing up, near z = 0
///     ceiling   level, facing down, at least as high as a door
///     wall      upright planes; a connected piece of one is a wall if it is large and reaches
///               higher than furniture does
///
/// The decision is made once for all views, on patches of surface
/// (upright/surface_elements.h); a pixel belongs to a part if it lies on the plane of one of
/// its patches.

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"
#include "reconstruction/upright/surface_elements.h"

namespace segsim::reconstruction {

enum class RoomPart : std::uint8_t { kNone, kFloor, kWall, kCeiling };

struct RoomPartOptions {
  double floor_band_m = 0.12;        ///< A floor's patches lie so close to z = 0.
  double ceiling_above_m = 2.0;      ///< A door is not higher.
  double wall_top_m = 2.15;          ///< Furniture is not higher; every wall was seen so high.
  double wall_area_m2 = 0.6;         ///< Of a connected piece.
  double plane_distance_m = 0.08;    ///< Of a patch from the plane that it counts for.
  double gap_m = 0.4;                ///< Pieces of one plane this close are connected.
  double distance_m = 0.03;          ///< Of a pixel from its patch's plane, at the camera ...
  double distance_per_depth = 0.01;  ///< ... and what is added per metre of depth.
  double least_cosine = 0.8;         ///< Between the normals of pixel and patch.
};

/// Measured points, sorted by the way that the surface faces: a wall between two rooms is
/// thinner than what a patch is fitted to, and without this its two sides would be one lump.
class FacingPoints {
 public:
  /// Adds every `step`-th pixel of every `step`-th row that has a depth and a normal.
  /// @param depth_m  Along +z; NaN = unknown.
  /// @param intrinsics  Of the depth image.
  void add_view(const core::Image<float>& depth_m, const core::CameraIntrinsics& intrinsics,
                const core::CameraPose& T_world_camera, int step);
  [[nodiscard]] bool empty() const;
  /// Patches of all ways, one way after another.
  [[nodiscard]] std::vector<SurfaceElement> elements(double element_m = kElement_m) const;

 private:
  std::array<std::vector<SeenPoint>, 6> seen_;  ///< Up, down, and four quarters around z.
};

class RoomParts {
 public:
  /// @param elements  World frame, z up, floor near z = 0; patches of edge `element_m`.
  explicit RoomParts(std::span<const SurfaceElement> elements,
                     const RoomPartOptions& options = {}, double element_m = kElement_m);

  /// Of each element, in their order.
  [[nodiscard]] const std::vector<RoomPart>& parts() const { return part_; }

  /// The part on which a point lies.
  /// @param normal  Unit, world frame, towards the camera; zero if it is not known.
  /// @param distance_m  Greatest from the plane of a patch.
  [[nodiscard]] RoomPart at(const glm::dvec3& p_m, const glm::vec3& normal,
                            double distance_m) const;

  /// The part of every pixel of a view; kNone where depth is unknown.
  /// @param depth_m  Along +z; NaN = unknown.
  /// @param intrinsics  Of the depth image.
  [[nodiscard]] core::Image<RoomPart> of_view(const core::Image<float>& depth_m,
                                              const core::CameraIntrinsics& intrinsics,
                                              const core::CameraPose& T_world_camera) const;

 private:
  void find_level_parts();
  void find_walls();

  RoomPartOptions options_;
  double element_m_;
  std::vector<SurfaceElement> elements_;
  std::vector<RoomPart> part_;
  /// Voxel -> elements of a part in it and beside it.
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> near_;
};

}  // namespace segsim::reconstruction
