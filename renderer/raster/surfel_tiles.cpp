#include "renderer/raster/surfel_tiles.h"

#include <algorithm>
#include <cmath>

#include "renderer/raster/compat_rules.h"

namespace segsim::renderer::internal {
namespace {

/// First tile whose last pixel centre, and tile after the last whose first one, lies in the
/// interval; inside the image. What is not a number (a degenerate conic) means all.
int first_tile(float lo_px, int tiles) {
  const float tile = std::ceil((lo_px - (kTileSizePx - 0.5F)) / kTileSizePx);
  return tile > 0.0F ? static_cast<int>(std::min(tile, static_cast<float>(tiles))) : 0;
}
int end_tile(float hi_px, int tiles) {
  const float tile = std::floor((hi_px - 0.5F) / kTileSizePx) + 1.0F;
  return tile < static_cast<float>(tiles) ? static_cast<int>(std::max(tile, 0.0F)) : tiles;
}

TileRange tiles_of(const ScreenBox<float>& box, const ProjectionJob& job) {
  const int tiles_x = (job.width_px + kTileSizePx - 1) / kTileSizePx;
  const int tiles_y = (job.height_px + kTileSizePx - 1) / kTileSizePx;
  TileRange range{first_tile(box.x_min_px, tiles_x), end_tile(box.x_max_px, tiles_x),
                  first_tile(box.y_min_px, tiles_y), end_tile(box.y_max_px, tiles_y)};
  range.x_end = std::max(range.x_end, range.x_begin);
  range.y_end = std::max(range.y_end, range.y_begin);
  return range;
}

/// Tiles that the 2DGS code lists.
TileRange tiles_of_three_sigma(const ProjectionJob& job, std::size_t i) {
  const PackedSurfels& p = job.packed;
  const auto wide = [](float x, float y, float z) {
    return Vec3<double>{static_cast<double>(x), static_cast<double>(y),
                        static_cast<double>(z)};
  };
  const auto wide_of = [&](const Vec3<float>& v) { return wide(v.x, v.y, v.z); };
  const ProjectionCamera<float>& c = job.camera;
  const ProjectionCamera<double> camera{wide_of(c.right),
                                        wide_of(c.down),
                                        wide_of(c.forward),
                                        wide_of(c.centre_m),
                                        static_cast<double>(c.fx_px),
                                        static_cast<double>(c.fy_px),
                                        static_cast<double>(c.cx_px),
                                        static_cast<double>(c.cy_px)};
  const auto s = project_surfel<double>(camera, wide(p.x_m[i], p.y_m[i], p.z_m[i]),
                                        wide(p.ux_m[i], p.uy_m[i], p.uz_m[i]),
                                        wide(p.vx_m[i], p.vy_m[i], p.vz_m[i]));
  const TileRectangle tiles =
      tiles_of_square(aabb_3_sigma(s), (job.width_px + kTileSizePx - 1) / kTileSizePx,
                      (job.height_px + kTileSizePx - 1) / kTileSizePx);
  return {tiles.x_begin, std::max(tiles.x_begin, tiles.x_end), tiles.y_begin,
          std::max(tiles.y_begin, tiles.y_end)};
}

}  // namespace

TileRange exact_range(const ScreenSurfel& s) {
  return {s.x_lo / kTileSizePx, s.x_hi / kTileSizePx + 1, s.y_lo / kTileSizePx,
          s.y_hi / kTileSizePx + 1};
}

TileRange approximate_range(const ProjectionJob& job, std::size_t i,
                            ScreenEllipse<float>& outline) {
  if (job.bounds == TileBounds::kAabb) return tiles_of_three_sigma(job, i);
  const PackedSurfels& p = job.packed;
  const auto projection = project_surfel<float>(job.camera, {p.x_m[i], p.y_m[i], p.z_m[i]},
                                                {p.ux_m[i], p.uy_m[i], p.uz_m[i]},
                                                {p.vx_m[i], p.vy_m[i], p.vz_m[i]});
  outline = paper_outline(projection, p.k2[i]);
  return tiles_of(with_low_pass(box_of(outline), projection, p.k2[i]), job);
}

}  // namespace segsim::renderer::internal
