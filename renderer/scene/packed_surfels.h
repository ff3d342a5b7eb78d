#pragma once

/// @file
/// A scene rearranged for projection: along a Morton curve, in clusters whose bounding spheres
/// are tested against the view first, one array per coordinate.

#include <cstddef>
#include <cstdint>
#include <vector>

#include <glm/vec3.hpp>

#include "renderer/scene/surfels.h"

namespace segsim::renderer::internal {

inline constexpr std::size_t kClusterSize = 64;

struct Cluster {
  glm::vec3 centre_m;
  float radius_m;          ///< Covers every disc out to alpha = 1/255.
  float centres_radius_m;  ///< Covers the centres.
};

/// Arrays have cluster_count() * kClusterSize entries; the last cluster is filled up with
/// surfels that are too faint to be drawn (k2 < 0).
struct PackedSurfels {
  std::vector<float> x_m, y_m, z_m;
  std::vector<float> ux_m, uy_m, uz_m;  ///< s_u t_u
  std::vector<float> vx_m, vy_m, vz_m;  ///< s_v t_v
  std::vector<float> log2_opacity, k2;
  std::vector<glm::vec3> normal;      ///< Unit.
  std::vector<glm::vec3> colour;      ///< >= 0; of degree 0 scenes only.
  std::vector<glm::vec3> sh;          ///< Of higher degrees: SurfelCloud::sh_count() each.
  std::vector<std::uint32_t> label;   ///< semantic | instance << 16
  std::vector<std::uint32_t> surfel;  ///< Index in the cloud.
  std::vector<Cluster> clusters;

  explicit PackedSurfels(const SurfelCloud& cloud);
  [[nodiscard]] std::size_t cluster_count() const { return clusters.size(); }
};

}  // namespace segsim::renderer::internal
