#include "renderer/scene/packed_surfels.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::internal {
namespace {

/// Spreads the lower 21 bits of x to every third bit.
std::uint64_t spread_bits(std::uint64_t x) {
  x &= 0x1FFFFF;
  x = (x | x << 32U) & 0x1F00000000FFFFU;
  x = (x | x << 16U) & 0x1F0000FF0000FFU;
  x = (x | x << 8U) & 0x100F00F00F00F00FU;
  x = (x | x << 4U) & 0x10C30C30C30C30C3U;
  x = (x | x << 2U) & 0x1249249249249249U;
  return x;
}

/// Surfel indices along a Morton curve through the scene's bounding box.
std::vector<std::uint32_t> morton_order(const std::vector<glm::vec3>& positions_m) {
  if (positions_m.empty()) return {};
  glm::vec3 lo = positions_m.front(), hi = positions_m.front();
  for (const glm::vec3& p : positions_m) {
    lo = glm::min(lo, p);
    hi = glm::max(hi, p);
  }
  const glm::vec3 size = hi - lo;
  const float longest_m = std::max({size.x, size.y, size.z, 1e-6F});
  const float cells_per_m = 2097151.0F / longest_m;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> keyed(positions_m.size());
  for (std::size_t i = 0; i < keyed.size(); ++i) {
    const glm::vec3 cell = (positions_m[i] - lo) * cells_per_m;
    keyed[i] = {spread_bits(static_cast<std::uint64_t>(cell.x)) |
                    spread_bits(static_cast<std::uint64_t>(cell.y)) << 1U |
                    spread_bits(static_cast<std::uint64_t>(cell.z)) << 2U,
                static_cast<std::uint32_t>(i)};
  }
  std::sort(keyed.begin(), keyed.end());
  std::vector<std::uint32_t> order(keyed.size());
  for (std::size_t i = 0; i < keyed.size(); ++i) order[i] = keyed[i].second;
  return order;
}

Cluster bounding_sphere(const SurfelCloud& cloud, const std::uint32_t* surfels,
                        std::size_t n) {
  glm::vec3 lo = cloud.position_m[surfels[0]], hi = lo;
  for (std::size_t i = 1; i < n; ++i) {
    lo = glm::min(lo, cloud.position_m[surfels[i]]);
    hi = glm::max(hi, cloud.position_m[surfels[i]]);
  }
  Cluster cluster{0.5F * (lo + hi), 0.0F, 0.0F};
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t s = surfels[i];
    const float k = std::sqrt(std::max(0.0F, extent_squared(cloud.opacity[s])));
    const float reach_m = k * std::max(cloud.scale_m[s].x, cloud.scale_m[s].y);
    const float distance_m = glm::length(cloud.position_m[s] - cluster.centre_m);
    cluster.centres_radius_m = std::max(cluster.centres_radius_m, distance_m * kBoundSlack);
    cluster.radius_m = std::max(cluster.radius_m, (distance_m + reach_m) * kBoundSlack);
  }
  return cluster;
}

}  // namespace

PackedSurfels::PackedSurfels(const SurfelCloud& cloud, std::span<const std::uint32_t> labels)
    : surfel(morton_order(cloud.position_m)) {
  const std::size_t n = cloud.size();
  const std::size_t cluster_total = (n + kClusterSize - 1) / kClusterSize;
  clusters.reserve(cluster_total);
  for (std::size_t c = 0; c < cluster_total; ++c) {
    const std::size_t first = c * kClusterSize;
    clusters.push_back(
        bounding_sphere(cloud, surfel.data() + first, std::min(kClusterSize, n - first)));
  }
  const std::size_t padded = cluster_total * kClusterSize;
  for (auto* array : {&x_m, &y_m, &z_m, &ux_m, &uy_m, &uz_m, &vx_m, &vy_m, &vz_m}) {
    array->assign(padded, 0.0F);
  }
  log2_opacity.assign(padded, -100.0F);
  k2.assign(padded, -1.0F);
  for (auto* array : {&nx, &ny, &nz}) array->assign(padded, 0.0F);
  const std::size_t coefficients = cloud.sh_count();
  const bool harmonics = cloud.sh_degree > 0;
  (harmonics ? sh : colour).assign(3 * padded * coefficients, 0.0F);
  label.assign(padded, 0);
  surfel.resize(padded, 0);
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint32_t s = surfel[i];
    const glm::vec3& p = cloud.position_m[s];
    const glm::mat3 R = glm::mat3_cast(cloud.R_world_surfel[s]);
    const glm::vec3 u = R[0] * cloud.scale_m[s].x;
    const glm::vec3 v = R[1] * cloud.scale_m[s].y;
    x_m[i] = p.x, y_m[i] = p.y, z_m[i] = p.z;
    ux_m[i] = u.x, uy_m[i] = u.y, uz_m[i] = u.z;
    vx_m[i] = v.x, vy_m[i] = v.y, vz_m[i] = v.z;
    log2_opacity[i] = std::log2(cloud.opacity[s]);
    k2[i] = extent_squared(cloud.opacity[s]);
    const glm::vec3 normal = glm::normalize(R[2]);
    nx[i] = normal.x, ny[i] = normal.y, nz[i] = normal.z;
    for (std::size_t k = 0; k < coefficients; ++k) {
      const glm::vec3& of = cloud.sh[s * coefficients + k];
      const glm::vec3 value = harmonics ? of : glm::max(0.5F + kShC0 * of, glm::vec3(0.0F));
      for (int c = 0; c < 3; ++c) {
        (harmonics ? sh
                   : colour)[plane_index(i, coefficients, k, static_cast<std::size_t>(c))] =
            value[c];
      }
    }
    if (!labels.empty()) {
      label[i] = labels[s];
    } else if (cloud.has_labels()) {
      label[i] = cloud.semantic_id[s] | static_cast<std::uint32_t>(cloud.instance_id[s])
                                            << 16U;
    }
  }
}

}  // namespace segsim::renderer::internal
