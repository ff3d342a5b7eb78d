#pragma once

/// @file
/// From surfels on the screen to the tiles' lists: the rows and then the tiles of a warp's
/// surfels are spread evenly over its lanes.

#include <cstdint>

#include "renderer/cuda/device_data.h"
#include "renderer/cuda/warp.cuh"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::cuda {

/// Rounding of a row's interval stays below this.
inline constexpr float kSpanSlackPx = 2e-3F;

/// Which tiles of its box a surfel is listed in.
enum class TilesRule : int {
  kAll,
  kRows,      ///< Those that the outline's rows reach.
  kQuarters,  ///< Those of which it reaches a quarter, with the quarters that it reaches.
};

/// A lane's surfel, as far as its tiles go.
struct Candidate {
  int x_begin, x_end, y_begin, y_end;  ///< Tiles.
  ScreenEllipse<float> outline;
  float x0_px, y0_px, low_pass_radius2, z0_m;
  TilesRule rule;
};

/// Tiles [begin, end) of a row; of its upper and lower half the columns of quarters [begin,
/// end), as begin | end << 16.
struct Span {
  int begin, end;
  std::uint32_t half[2];
};

/// Columns of `kColumnPx` pixels that the outline reaches in a band of rows.
template <int kColumnPx, int kRowsPx>
__device__ inline int2 columns_of(const Candidate& c, float y_lo, int least, int most) {
  const ColumnSpan<float> span =
      columns_in_band(c.outline, c.x0_px, c.y0_px, c.low_pass_radius2, y_lo,
                      y_lo + static_cast<float>(kRowsPx - 1));
  if (span.x_min_px > span.x_max_px) return {least, least};
  const float slack = fmaxf(span.x_max_px - span.x_min_px, 0.0F) * 1e-4F + kSpanSlackPx;
  const float first =
      ceilf((span.x_min_px - slack - (static_cast<float>(kColumnPx) - 0.5F)) / kColumnPx);
  const float last = floorf((span.x_max_px + slack - 0.5F) / kColumnPx);
  // In this order a number that is none leaves the whole range.
  const float begin = fminf(fmaxf(static_cast<float>(least), first), static_cast<float>(most));
  const float end = fminf(static_cast<float>(most), last + 1.0F);
  return {static_cast<int>(begin), static_cast<int>(fmaxf(begin, end))};
}

__device__ inline Span tiles_in_row(const Candidate& c, int row) {
  const auto packed = [](int begin, int end) {
    return static_cast<std::uint32_t>(begin) | static_cast<std::uint32_t>(end) << 16U;
  };
  const float y_lo = static_cast<float>(row * kTilePx) + 0.5F;
  const std::uint32_t all = packed(2 * c.x_begin, 2 * c.x_end);
  if (c.rule == TilesRule::kAll) return {c.x_begin, c.x_end, {all, all}};
  if (c.rule == TilesRule::kRows) {
    const int2 tiles = columns_of<kTilePx, kTilePx>(c, y_lo, c.x_begin, c.x_end);
    return {tiles.x, tiles.y, {all, all}};
  }
  constexpr int kHalf = kTilePx / 2;
  const int2 upper = columns_of<kHalf, kHalf>(c, y_lo, 2 * c.x_begin, 2 * c.x_end);
  const int2 lower = columns_of<kHalf, kHalf>(c, y_lo + kHalf, 2 * c.x_begin, 2 * c.x_end);
  const std::uint32_t halves[2] = {packed(upper.x, upper.y), packed(lower.x, lower.y)};
  if (upper.x == upper.y) return {lower.x / 2, (lower.y + 1) / 2, {halves[0], halves[1]}};
  if (lower.x == lower.y) return {upper.x / 2, (upper.y + 1) / 2, {halves[0], halves[1]}};
  return {min(upper.x, lower.x) / 2, (max(upper.y, lower.y) + 1) / 2, {halves[0], halves[1]}};
}

/// Quarters of tile `x` that a span reaches: bits 0 and 1 above, 2 and 3 below.
__device__ inline std::uint32_t quarters_of(int x, std::uint32_t upper, std::uint32_t lower) {
  const auto reaches = [](int column, std::uint32_t half) {
    return column >= static_cast<int>(half & 0xFFFFU) && column < static_cast<int>(half >> 16U)
               ? 1U
               : 0U;
  };
  return reaches(2 * x, upper) | reaches(2 * x + 1, upper) << 1U |
         reaches(2 * x, lower) << 2U | reaches(2 * x + 1, lower) << 3U;
}

__device__ inline Candidate from_lane(const Candidate& c, int lane) {
  const auto get = [lane](auto value) { return __shfl_sync(kAllLanes, value, lane); };
  Candidate r;
  r.x_begin = get(c.x_begin), r.x_end = get(c.x_end);
  r.y_begin = get(c.y_begin), r.y_end = get(c.y_end);
  r.outline = {get(c.outline.cx_px), get(c.outline.cy_px), get(c.outline.sxx),
               get(c.outline.sxy), get(c.outline.syy)};
  r.x0_px = get(c.x0_px), r.y0_px = get(c.y0_px);
  r.low_pass_radius2 = get(c.low_pass_radius2), r.z0_m = get(c.z0_m);
  r.rule = static_cast<TilesRule>(get(static_cast<int>(c.rule)));
  return r;
}

/// Is the tile's list to have the surfel in this pass?
template <bool kRedo>
__device__ inline bool admits(const FrameView& frame, int tile, float z0_m) {
  if constexpr (kRedo) return frame.redo[tile] != 0 && z0_m > frame.bound_m[tile];
  return !frame.culls || z0_m <= frame.bound_m[tile];
}

/// Places in the lists of the lanes' tiles; lanes with the same tile share an atomic.
/// @param tile  Negative: none.
__device__ inline std::uint32_t take_slot(const FrameView& frame, int tile) {
  const unsigned peers = __match_any_sync(kAllLanes, tile);
  const int leader = __ffs(static_cast<int>(peers)) - 1;
  std::uint32_t slot = 0;
  if (tile >= 0 && lane_index() == leader) {
    slot = atomicAdd(&frame.count[tile], static_cast<std::uint32_t>(__popc(peers)));
  }
  const unsigned before = peers & ((1U << lane_index()) - 1U);
  return __shfl_sync(kAllLanes, slot, leader) + static_cast<std::uint32_t>(__popc(before));
}

/// Spreads the tiles of all lanes' rows over the warp and adds them to the lists.
template <bool kRedo>
__device__ inline void emit_spans(const FrameView& frame, int first_tile, const Span& span,
                                  int row, float z0_m, std::uint32_t id) {
  const int lane = lane_index();
  const int tiles = inclusive_sum(span.end - span.begin);
  const int tile_count = __shfl_sync(kAllLanes, tiles, kWarp - 1);
  for (int first = 0; first < tile_count; first += kWarp) {
    const int t = min(first + lane, tile_count - 1);
    const int from = lane_of(tiles, t);
    const int left = __shfl_sync(kAllLanes, tiles, from) - t;
    const int x = __shfl_sync(kAllLanes, span.end, from) - left;
    const int row_tile = __shfl_sync(kAllLanes, first_tile + row * frame.tiles_x, from);
    const float depth_m = __shfl_sync(kAllLanes, z0_m, from);
    const std::uint32_t surfel = __shfl_sync(kAllLanes, id, from);
    const std::uint32_t upper = __shfl_sync(kAllLanes, span.half[0], from);
    const std::uint32_t lower = __shfl_sync(kAllLanes, span.half[1], from);
    const std::uint32_t quarters = quarters_of(x, upper, lower);
    const int tile = row_tile + x;
    const bool wanted =
        first + lane < tile_count && quarters != 0 && admits<kRedo>(frame, tile, depth_m);
    const std::uint32_t slot = take_slot(frame, wanted ? tile : -1);
    if (!wanted || slot >= frame.capacity) continue;  // FrameStatus::longest_list will tell.
    frame.bucket[static_cast<std::size_t>(tile) * frame.capacity + slot] =
        static_cast<ListKey>(__float_as_uint(depth_m)) << 32 | surfel << kQuarterBits |
        quarters;
  }
}

__device__ inline int first_tile_of(const FrameView& frame, int camera) {
  return camera * frame.tiles_x * frame.tiles_y;
}

/// Adds the surfels of all lanes to the lists of their tiles.
template <bool kRedo>
__device__ inline void emit(const FrameView& frame, int camera, const Candidate& mine,
                            bool drawn, std::uint32_t id) {
  const int lane = lane_index();
  const int rows = inclusive_sum(drawn ? mine.y_end - mine.y_begin : 0);
  const int row_count = __shfl_sync(kAllLanes, rows, kWarp - 1);
  for (int base = 0; base < row_count; base += kWarp) {
    const int at = min(base + lane, row_count - 1);
    const int owner = lane_of(rows, at);
    const Candidate c = from_lane(mine, owner);
    const std::uint32_t row_id = __shfl_sync(kAllLanes, id, owner);
    const int row = c.y_end - (__shfl_sync(kAllLanes, rows, owner) - at);
    Span span{0, 0, {0, 0}};
    if (base + lane < row_count) span = tiles_in_row(c, row);
    emit_spans<kRedo>(frame, first_tile_of(frame, camera), span, row, c.z0_m, row_id);
  }
}

}  // namespace segsim::renderer::cuda
