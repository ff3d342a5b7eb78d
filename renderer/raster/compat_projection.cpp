#include "renderer/raster/compat_projection.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include <glm/geometric.hpp>

#include "renderer/raster/compat_rules.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::internal {
namespace {

constexpr double kHalfLog2E = 0.72134752044448170;
/// |det J| below this times |J|^2 is edge-on here. Neither program has such a threshold; this
/// one keeps M within the range of float.
constexpr double kCompatEdgeOn = 1e-12;

Vec3<double> wide(float x, float y, float z) {
  return {static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)};
}
Vec3<double> wide(const Vec3<float>& v) { return wide(v.x, v.y, v.z); }

ProjectionCamera<double> wide(const ProjectionCamera<float>& c) {
  return {wide(c.right),
          wide(c.down),
          wide(c.forward),
          wide(c.centre_m),
          static_cast<double>(c.fx_px),
          static_cast<double>(c.fy_px),
          static_cast<double>(c.cx_px),
          static_cast<double>(c.cy_px)};
}

/// J^-1 and g without the threshold of project_surfel(); false if J has no inverse.
bool invert(SurfelProjection<double>& s) {
  const double det = s.a0 * s.b1 - s.a1 * s.b0;
  const double norm2 = s.a0 * s.a0 + s.a1 * s.a1 + s.b0 * s.b0 + s.b1 * s.b1;
  if (!(std::abs(det) > kCompatEdgeOn * norm2)) return false;
  s.m00 = s.b1 / det;
  s.m01 = -s.a1 / det;
  s.m10 = -s.b0 / det;
  s.m11 = s.a0 / det;
  s.g0 = s.w0 * s.m00 + s.w1 * s.m10;
  s.g1 = s.w0 * s.m01 + s.w1 * s.m11;
  return true;
}

/// First pixel of a tile, or last one before a tile for offset -1.
std::uint16_t pixel_of_tile(int tile, int offset_px, int last_px) {
  return static_cast<std::uint16_t>(std::clamp(tile * kCompatTilePx + offset_px, 0, last_px));
}

ScreenSurfel screen_surfel(const SurfelProjection<double>& s, const ConicBox<double>& box,
                           double k2, float z0_m, Compat compat) {
  const double inverse_k = 1.0 / std::sqrt(k2);
  ScreenSurfel screen{};
  screen.x0_px = static_cast<float>(s.x0_px);
  screen.y0_px = static_cast<float>(s.y0_px);
  screen.m00 = static_cast<float>(s.m00 * inverse_k);
  screen.m01 = static_cast<float>(s.m01 * inverse_k);
  screen.m10 = static_cast<float>(s.m10 * inverse_k);
  screen.m11 = static_cast<float>(s.m11 * inverse_k);
  screen.g0 = static_cast<float>(s.g0);
  screen.g1 = static_cast<float>(s.g1);
  screen.z0_m = z0_m;
  screen.c_k2 = static_cast<float>(kHalfLog2E * k2);
  screen.e_min = static_cast<float>(box.cx_px - s.x0_px);
  screen.e_max = static_cast<float>(box.cy_px - s.y0_px);
  screen.shape = compat == Compat::kInria ? SurfelShape::kInria : SurfelShape::kGsplat;
  return screen;
}

class CompatProjection {
 public:
  CompatProjection(const ProjectionJob& job, Compat compat)
      : job_(job),
        compat_(compat),
        rules_(rules_of(compat)),
        camera_(wide(job.camera)),
        tiles_x_((job.width_px + kCompatTilePx - 1) / kCompatTilePx),
        tiles_y_((job.height_px + kCompatTilePx - 1) / kCompatTilePx) {}

  /// Projects visible cluster number v.
  void project_cluster(std::size_t v, ProjectedSurfels& out, TileWriter& writer) const {
    const std::size_t first = out.visible[v].cluster * kClusterSize;
    const std::size_t first_slot = v * kClusterSize;
    std::size_t slot = first_slot;
    for (std::size_t i = first; i < first + kClusterSize; ++i) {
      if (project(i, slot, out, writer)) ++slot;
    }
    out.count[v] = static_cast<std::uint32_t>(slot - first_slot);
  }

 private:
  /// @return  False if the program does not draw packed surfel i.
  bool project(std::size_t i, std::size_t slot, ProjectedSurfels& out,
               TileWriter& writer) const {
    const PackedSurfels& p = job_.packed;
    const float z0_m = depth_of_centre<float>(job_.camera, {p.x_m[i], p.y_m[i], p.z_m[i]});
    if (!(z0_m > rules_.near_m && z0_m < rules_.far_m) || !(p.k2[i] > 0.0F)) return false;
    SurfelProjection<double> s = project_surfel<double>(
        camera_, wide(p.x_m[i], p.y_m[i], p.z_m[i]), wide(p.ux_m[i], p.uy_m[i], p.uz_m[i]),
        wide(p.vx_m[i], p.vy_m[i], p.vz_m[i]));
    const bool invertible = invert(s);
    if (!invertible && rules_.cull_edge_on) return false;
    const ConicBox<double> box = box_of_dual_conic(s, rules_.box_k2);
    const TileRectangle tiles = compat_tiles(compat_, box, tiles_x_, tiles_y_);
    if (tiles.empty()) return false;
    ScreenSurfel& screen = out.screen[slot];
    screen = screen_surfel(s, box, static_cast<double>(p.k2[i]), z0_m, compat_);
    screen.x_lo = pixel_of_tile(tiles.x_begin, 0, job_.width_px - 1);
    screen.x_hi = pixel_of_tile(tiles.x_end, -1, job_.width_px - 1);
    screen.y_lo = pixel_of_tile(tiles.y_begin, 0, job_.height_px - 1);
    screen.y_hi = pixel_of_tile(tiles.y_end, -1, job_.height_px - 1);
    out.shade[slot] = shade_of(job_, i);
    const DepthSlot entry =
        DepthSlot{std::bit_cast<std::uint32_t>(z0_m)} << 32U | static_cast<DepthSlot>(slot);
    for (int y = tiles.y_begin; y < tiles.y_end; ++y) {
      writer.add_row(y, tiles.x_begin, tiles.x_end, entry);
    }
    return true;
  }

  const ProjectionJob& job_;
  Compat compat_;
  CompatRules rules_;
  ProjectionCamera<double> camera_;
  int tiles_x_, tiles_y_;
};

}  // namespace

void find_clusters_compat(const ProjectionJob& job, ProjectedSurfels& projected) {
  /// Rounding of a centre's depth, relative to its distance.
  constexpr float kDepthSlack = 1e-5F;
  projected.visible.clear();
  for (std::size_t i = 0; i < job.packed.cluster_count(); ++i) {
    const Cluster& cluster = job.packed.clusters[i];
    const Vec3<float>& eye = job.camera.centre_m;
    const glm::vec3 offset = cluster.centre_m - glm::vec3(eye.x, eye.y, eye.z);
    const float z = dot(job.camera.forward, Vec3<float>{offset.x, offset.y, offset.z});
    const float slack = kDepthSlack * (1.0F + glm::length(offset));
    projected.visible.push_back(
        {z - cluster.centres_radius_m - slack, static_cast<std::uint32_t>(i), {}});
  }
  std::sort(projected.visible.begin(), projected.visible.end(),
            [](const VisibleCluster& a, const VisibleCluster& b) {
              return a.nearest_m != b.nearest_m ? a.nearest_m < b.nearest_m
                                                : a.cluster < b.cluster;
            });
}

void project_clusters_compat(const ProjectionJob& job, Compat compat, std::size_t begin,
                             std::size_t end, Workers& workers, ProjectedSurfels& projected,
                             TileBins& bins) {
  projected.reserve(end);
  const CompatProjection projection(job, compat);
  const std::size_t task_count = (end - begin + kClustersPerTask - 1) / kClustersPerTask;
  workers.for_each(task_count, [&](std::size_t task) {
    TileWriter& writer = bins.writer(workers.thread_index());
    const std::size_t first = begin + task * kClustersPerTask;
    for (std::size_t v = first; v < std::min(end, first + kClustersPerTask); ++v) {
      projection.project_cluster(v, projected, writer);
    }
  });
}

}  // namespace segsim::renderer::internal
