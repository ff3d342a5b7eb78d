/// @file
/// Tile rows of a surfel's outline, for a vector of rows at a time.
///
/// Included once for every instruction set.

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "renderer/raster/projection.h"
#include "renderer/raster/surfel_tiles.h"

#if defined(SEGSIM_RENDERER_EXACT_ROWS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SEGSIM_RENDERER_EXACT_ROWS_INL_H
#undef SEGSIM_RENDERER_EXACT_ROWS_INL_H
#else
#define SEGSIM_RENDERER_EXACT_ROWS_INL_H
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer::internal {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Rounding of a row interval [px].
constexpr float kSpanSlackPx = 2e-3F;

/// Half of the outline's width along the line at `y` from its centre.
template <class D>
HWY_INLINE hn::Vec<D> half_width_at(D d, hn::Vec<D> y, hn::Vec<D> minor,
                                    hn::Vec<D> inverse_syy) {
  using Rows = hn::Vec<D>;
  const Rows inside = hn::NegMulAdd(hn::Mul(y, y), inverse_syy, hn::Set(d, 1.0F));
  return hn::Sqrt(hn::Mul(minor, hn::Max(hn::Zero(d), inside)));
}

/// The exact rows of an outline (AccuTile of Hanson et al. 2025): columns_in_band() for a
/// vector of tile rows at a time.
template <class D>
HWY_INLINE void add_exact_rows(D d, const ScreenSurfel& s, const ScreenEllipse<float>& outline,
                               const TileRange& range, DepthSlot entry, TileWriter& writer) {
  using Rows = hn::Vec<D>;
  const hn::RebindToSigned<D> di;
  constexpr auto kTile = static_cast<float>(kTileSizePx);
  const float slope = outline.sxy / outline.syy;
  const Rows half_height = hn::Set(d, std::sqrt(outline.syy));
  const Rows minor = hn::Set(d, std::max(0.0F, outline.sxx - outline.sxy * slope));
  const Rows inverse_syy = hn::Set(d, 1.0F / outline.syy);
  const float extreme = outline.sxx > 0.0F ? outline.sxy / std::sqrt(outline.sxx) : 0.0F;
  // k^2 / 2 = ln 2 c_k2.
  const Rows radius2 = hn::Set(d, 0.69314718F * s.c_k2 * kBoundSlack);
  const Rows lowest = hn::Set(d, static_cast<float>(range.x_begin));
  const Rows highest = hn::Set(d, static_cast<float>(range.x_end));
  const Rows centre_x = hn::Set(d, outline.cx_px);
  for (int row = range.y_begin; row < range.y_end; row += static_cast<int>(hn::Lanes(d))) {
    const Rows number = hn::Add(hn::Load(d, kCounting), hn::Set(d, static_cast<float>(row)));
    const Rows y_lo = hn::MulAdd(number, hn::Set(d, kTile), hn::Set(d, 0.5F));
    const Rows y_hi = hn::Add(y_lo, hn::Set(d, kTile - 1.0F));
    const Rows lo = hn::Max(hn::Sub(y_lo, hn::Set(d, outline.cy_px)), hn::Neg(half_height));
    const Rows hi = hn::Min(hn::Sub(y_hi, hn::Set(d, outline.cy_px)), half_height);
    const auto reached = hn::Le(lo, hi);
    const Rows y_right = hn::Min(hn::Max(hn::Set(d, extreme), lo), hi);
    const Rows y_left = hn::Min(hn::Max(hn::Set(d, -extreme), lo), hi);
    const Rows right = hn::Add(hn::MulAdd(hn::Set(d, slope), y_right, centre_x),
                               half_width_at(d, y_right, minor, inverse_syy));
    const Rows left = hn::Sub(hn::MulAdd(hn::Set(d, slope), y_left, centre_x),
                              half_width_at(d, y_left, minor, inverse_syy));
    Rows x_max = hn::IfThenElse(reached, right, hn::Set(d, -1e30F));
    Rows x_min = hn::IfThenElse(reached, left, hn::Set(d, 1e30F));
    if (s.shape != SurfelShape::kPlain) {  // Else the low pass lies within the outline.
      const Rows y0 = hn::Set(d, s.y0_px), x0 = hn::Set(d, s.x0_px);
      const Rows dy = hn::Max(hn::Max(hn::Sub(y_lo, y0), hn::Sub(y0, y_hi)), hn::Zero(d));
      const Rows h2 = hn::NegMulAdd(dy, dy, radius2);
      const Rows h = hn::Sqrt(hn::Max(h2, hn::Zero(d)));
      const auto meets = hn::Ge(h2, hn::Zero(d));
      x_min = hn::IfThenElse(meets, hn::Min(x_min, hn::Sub(x0, h)), x_min);
      x_max = hn::IfThenElse(meets, hn::Max(x_max, hn::Add(x0, h)), x_max);
    }
    // From the column whose last pixel centre reaches the span to that whose first one does.
    const Rows slack = hn::MulAdd(hn::Max(hn::Sub(x_max, x_min), hn::Zero(d)),
                                  hn::Set(d, 1e-4F), hn::Set(d, kSpanSlackPx + kTile - 0.5F));
    const Rows inverse_tile = hn::Set(d, 1.0F / kTile);
    const Rows first = hn::Ceil(hn::Mul(hn::Sub(x_min, slack), inverse_tile));
    const Rows last = hn::Floor(hn::Mul(hn::Add(x_max, slack), inverse_tile));
    alignas(64) std::int32_t begins[hn::MaxLanes(d)], ends[hn::MaxLanes(d)];
    hn::Store(hn::ConvertTo(di, hn::Min(hn::Max(first, lowest), highest)), di, begins);
    hn::Store(hn::ConvertTo(di, hn::Min(hn::Max(last, lowest), highest)), di, ends);
    const int rows = std::min(static_cast<int>(hn::Lanes(d)), range.y_end - row);
    for (int r = 0; r < rows; ++r) writer.add_row(row + r, begins[r], ends[r], entry);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer::internal
HWY_AFTER_NAMESPACE();

#endif  // SEGSIM_RENDERER_EXACT_ROWS_INL_H
