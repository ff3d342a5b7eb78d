#pragma once

/// @file
/// The rules of the two 2DGS programs whose checkpoints we render, side by side, in our own
/// words: hbb1/diff-surfel-rasterization e0ed020 ("inria") and nerfstudio-project/gsplat
/// 90d7b4b3, its 2DGS part. What both share with this project is not repeated: kMaxAlpha,
/// kMinAlpha, rho = min(rho_disc, 2 |d|^2), blending in order of centre depth, the median
/// rule.
///
///     rule                      inria                            gsplat
///
///     box of a surfel           square of 3 sigma                3.33 x the 1-sigma box
///
///     applied by                tiles of 16 px                   tiles of 16 px
///
///     tiles counted from        centre of the first pixel        edge of the image
///
///     centre of the low pass    of the 3-sigma conic             of the 1-sigma conic
///
///     surfel dropped            z <= 0.2; D = 0; edge-on         z <= 0.2, z >= 200; D = 0
///
///     fragment dropped          depth of the plane < 0.2         never: ghosts from behind
///
///     pixel finished            T (1 - alpha) < 1e-4             T (1 - alpha) <= 1e-4
///
///     depth of a fragment       of the plane at the pixel        of the surfel's centre
///
/// D = 1 - k^2 |w|^2 of the conic used for the box. Neither knows a threshold for discs that
/// are nearly edge-on, nor limits the depth where the low pass decides.
///
/// Pixel centres: the 2DGS code has them at integers and its principal point at (W - 1) / 2,
/// gsplat at halves and W / 2. A ray is the same in both; only the tiles of a box differ.

#include <algorithm>
#include <cmath>

#include "renderer/scene/render_options.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::internal {

struct CompatRules {
  float near_m;           ///< A centre at or before it drops the surfel.
  float far_m;            ///< So does one at or beyond it.
  double box_k2;          ///< Of the conic whose box is taken; its centre is the low pass's.
  bool cull_edge_on;      ///< A disc whose plane holds the eye exactly is dropped.
  bool fragments_near;    ///< Fragments before near_m, or behind the camera, are dropped.
  bool centre_depth;      ///< Fragments have the depth of the surfel's centre.
  bool stop_at_equality;  ///< A pixel is finished at kCompatStop already, not only below.
};

/// Both programs' T; ours is just under it (see kStopTransmittance).
inline constexpr double kCompatStop = 1e-4;
/// The same where T is kept in float by subtraction: two surfels at kMaxAlpha, which both
/// programs stop at, must stay below it after rounding, so that equality does not matter.
inline constexpr float kCompatStopInFloat = 1.00002e-4F;
/// gsplat scales the box of 1 sigma by this: "3.33" bounds alpha = 1/255 at opacity 1.
inline constexpr double kGsplatBoxScale = 3.33;
/// Hard-coded in the 2DGS code ("near_n"); the default of gsplat's 2DGS trainer, whose
/// rasterizer takes it as an argument.
inline constexpr float kCompatNearM = 0.2F;
/// gsplat's trainer again. The 2DGS code uses its own (100) for the distortion loss only.
inline constexpr float kGsplatFarM = 200.0F;
inline constexpr int kCompatTilePx = 16;

/// @param compat  Not kExact.
[[nodiscard]] constexpr CompatRules rules_of(Compat compat) {
  if (compat == Compat::kInria) {
    return {.near_m = kCompatNearM,
            .far_m = 1e30F,
            .box_k2 = 9.0,
            .cull_edge_on = true,
            .fragments_near = true,
            .centre_depth = false,
            .stop_at_equality = false};
  }
  return {.near_m = kCompatNearM,
          .far_m = kGsplatFarM,
          .box_k2 = 1.0,
          .cull_edge_on = false,
          .fragments_near = false,
          .centre_depth = true,
          .stop_at_equality = true};
}

/// Would a surfel that leaves transmittance `left` finish the pixel?
[[nodiscard]] constexpr bool finishes(const CompatRules& rules, double left) {
  return rules.stop_at_equality ? left <= kCompatStop : left < kCompatStop;
}

/// Tiles [x_begin, x_end) x [y_begin, y_end).
struct TileRectangle {
  int x_begin, x_end, y_begin, y_end;

  [[nodiscard]] constexpr bool empty() const { return x_begin >= x_end || y_begin >= y_end; }
  [[nodiscard]] constexpr bool contains(int x, int y) const {
    return x >= x_begin && x < x_end && y >= y_begin && y < y_end;
  }
};

/// A tile number from any float, NaN included (which gives 0).
[[nodiscard]] inline int limited_tile(double tile, int count) {
  return static_cast<int>(lesser(larger(tile, 0.0), static_cast<double>(count)));
}

/// As the 2DGS code lists a square, with c = x - 0.5 from the first pixel's centre: tiles from
/// trunc(c_min / 16) to before trunc((c_max + 15) / 16). A tile into which the square reaches
/// by less than one pixel at its left or upper side is thus not listed.
[[nodiscard]] inline TileRectangle tiles_of_square(const ScreenBox<double>& box, int tiles_x,
                                                   int tiles_y) {
  const auto first = [](double px, int count) {
    return limited_tile((px - 0.5) / kCompatTilePx, count);
  };
  const auto end = [](double px, int count) {
    return limited_tile((px - 0.5 + (kCompatTilePx - 1)) / kCompatTilePx, count);
  };
  return {first(box.x_min_px, tiles_x), end(box.x_max_px, tiles_x),
          first(box.y_min_px, tiles_y), end(box.y_max_px, tiles_y)};
}

/// As gsplat lists a box: tiles from floor(x_min / 16) to before ceil(x_max / 16).
[[nodiscard]] inline TileRectangle tiles_of_gsplat_box(const ScreenBox<double>& box,
                                                       int tiles_x, int tiles_y) {
  const auto first = [](double px, int count) {
    return limited_tile(px / kCompatTilePx, count);
  };
  const auto end = [](double px, int count) {
    return limited_tile(std::ceil(px / kCompatTilePx), count);
  };
  return {first(box.x_min_px, tiles_x), end(box.x_max_px, tiles_x),
          first(box.y_min_px, tiles_y), end(box.y_max_px, tiles_y)};
}

/// Tiles of a surfel from the box of its conic at CompatRules::box_k2; none if it is dropped.
[[nodiscard]] inline TileRectangle compat_tiles(Compat compat, const ConicBox<double>& box,
                                                int tiles_x, int tiles_y) {
  if (!box.valid) return {0, 0, 0, 0};
  const double x = box.cx_px, y = box.cy_px;
  if (compat == Compat::kInria) {
    const double half = half_of_3_sigma_square(box);
    return tiles_of_square({x - half, x + half, y - half, y + half}, tiles_x, tiles_y);
  }
  const double half_width = std::ceil(kGsplatBoxScale * box.half_width_px);
  const double half_height = std::ceil(kGsplatBoxScale * box.half_height_px);
  return tiles_of_gsplat_box(
      {x - half_width, x + half_width, y - half_height, y + half_height}, tiles_x, tiles_y);
}

}  // namespace segsim::renderer::internal
