#include <algorithm>
#include <cmath>
#include <utility>

#include "renderer/raster/projection.h"

namespace segsim::renderer::internal {
namespace {

/// Image plane widened by the low pass: it reaches this far past a surfel's outline.
constexpr float kFrustumMarginPx = 3.0F;
/// Rounding of a centre's depth, relative to its distance.
constexpr float kDepthSlack = 1e-5F;

/// Tiles along one axis that a box of points can reach.
/// @param lateral_m  Middle of the box along the axis, camera frame.
/// @param z_m        The same along +z; `radius_m` less is in front of the camera.
/// @return  First tile and the one after the last.
std::pair<std::uint16_t, std::uint16_t> tiles_along(float lateral_m, float z_m, float radius_m,
                                                    float focal_px, float centre_px,
                                                    int size_px) {
  const float lo_m = lateral_m - radius_m, hi_m = lateral_m + radius_m;
  const float near_m = z_m - radius_m, far_m = z_m + radius_m;
  const float lo_px =
      centre_px + focal_px * lo_m / (lo_m < 0.0F ? near_m : far_m) - kFrustumMarginPx;
  const float hi_px =
      centre_px + focal_px * hi_m / (hi_m > 0.0F ? near_m : far_m) + kFrustumMarginPx;
  const auto last = static_cast<float>(size_px - 1);
  const auto tile = [last](float px) {
    return static_cast<int>(std::clamp(px, 0.0F, last)) / kTileSizePx;
  };
  return {static_cast<std::uint16_t>(tile(lo_px)),
          static_cast<std::uint16_t>(tile(hi_px) + 1)};
}

/// @param x_m, y_m, z_m  The cluster's centre in the camera's frame.
TileBox tiles_of_cluster(const ProjectionJob& job, float x_m, float y_m, float z_m,
                         float radius_m) {
  const auto tiles = [](int px) {
    return static_cast<std::uint16_t>((px + kTileSizePx - 1) / kTileSizePx);
  };
  if (z_m - radius_m <= job.near_m) return {0, tiles(job.width_px), 0, tiles(job.height_px)};
  const ProjectionCamera<float>& c = job.camera;
  const auto [x_begin, x_end] =
      tiles_along(x_m, z_m, radius_m, c.fx_px, c.cx_px, job.width_px);
  const auto [y_begin, y_end] =
      tiles_along(y_m, z_m, radius_m, c.fy_px, c.cy_px, job.height_px);
  return {x_begin, x_end, y_begin, y_end};
}

}  // namespace

void find_visible_clusters(const ProjectionJob& job, ProjectedSurfels& projected) {
  const ProjectionCamera<float>& c = job.camera;
  const float left = (-kFrustumMarginPx - c.cx_px) / c.fx_px;
  const float right =
      (static_cast<float>(job.width_px) + kFrustumMarginPx - c.cx_px) / c.fx_px;
  const float top = (-kFrustumMarginPx - c.cy_px) / c.fy_px;
  const float bottom =
      (static_cast<float>(job.height_px) + kFrustumMarginPx - c.cy_px) / c.fy_px;
  const float left_norm = std::hypot(1.0F, left), right_norm = std::hypot(1.0F, right);
  const float top_norm = std::hypot(1.0F, top), bottom_norm = std::hypot(1.0F, bottom);
  std::vector<VisibleCluster>& visible = projected.visible;
  visible.clear();
  visible.reserve(job.packed.cluster_count());
  for (std::size_t i = 0; i < job.packed.cluster_count(); ++i) {
    const Cluster& cluster = job.packed.clusters[i];
    const float r = cluster.radius_m;
    const Vec3<float> offset{cluster.centre_m.x - c.centre_m.x,
                             cluster.centre_m.y - c.centre_m.y,
                             cluster.centre_m.z - c.centre_m.z};
    const float z = dot(c.forward, offset);
    const float x = dot(c.right, offset);
    const float y = dot(c.down, offset);
    if (z + r < job.near_m) continue;
    if (x - z * left < -r * left_norm || x - z * right > r * right_norm) continue;
    if (y - z * top < -r * top_norm || y - z * bottom > r * bottom_norm) continue;
    const float nearest_m = z - cluster.centres_radius_m;
    visible.push_back({nearest_m - kDepthSlack * (1.0F + std::abs(x) + std::abs(y) + z),
                       static_cast<std::uint32_t>(i), tiles_of_cluster(job, x, y, z, r)});
  }
  std::sort(
      visible.begin(), visible.end(), [](const VisibleCluster& a, const VisibleCluster& b) {
        return a.nearest_m != b.nearest_m ? a.nearest_m < b.nearest_m : a.cluster < b.cluster;
      });
}

}  // namespace segsim::renderer::internal
