#pragma once

/// @file
/// A scene rearranged for projection: along a Morton curve, in clusters whose bounding spheres
/// are tested against the view first, one array per coordinate.

#include <cstddef>
#include <cstdint>
#include <span>
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
  std::vector<float> nx, ny, nz;  ///< Normal, unit.
  /// Red of a cluster's surfels, then green, then blue: >= 0; of degree 0 scenes only. Of
  /// higher degrees the same for every coefficient in turn (SurfelCloud::sh_count()): see
  /// plane_index().
  std::vector<float> colour, sh;
  std::vector<std::uint32_t> label;   ///< The cloud's are semantic | instance << 16.
  std::vector<std::uint32_t> surfel;  ///< Index in the cloud.
  std::vector<Cluster> clusters;

  /// @param labels  By index in the cloud, in place of the cloud's own; may be empty.
  explicit PackedSurfels(const SurfelCloud& cloud, std::span<const std::uint32_t> labels = {});
  [[nodiscard]] std::size_t cluster_count() const { return clusters.size(); }
  /// Where channel 0 ... 2 of a surfel's coefficient lies, or, of one coefficient, its colour.
  [[nodiscard]] static constexpr std::size_t plane_index(std::size_t surfel,
                                                         std::size_t coefficients,
                                                         std::size_t coefficient,
                                                         std::size_t channel) {
    const std::size_t plane =
        (surfel / kClusterSize * coefficients + coefficient) * 3 + channel;
    return plane * kClusterSize + surfel % kClusterSize;
  }
};

}  // namespace segsim::renderer::internal
