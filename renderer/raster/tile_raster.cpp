#include "renderer/raster/tile_raster.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <span>

#include "renderer/raster/tile_state.h"
#include "renderer/raster/tile_write.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/raster/tile_raster.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

// clang-format off: each target includes these two again.
#include "renderer/raster/tile_cell-inl.h"
#include "renderer/raster/tile_chunk-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer::internal {
namespace HWY_NAMESPACE {

/// Transposes a cell: four columns of four rows become four rows.
/// @param rows  Of the tile; the first is that of the cell's upper left pixel.
template <class T>
HWY_INLINE void cell_to_rows(const T* cell, T* rows) {
#if HWY_TARGET == HWY_SCALAR
  for (int i = 0; i < kCellPixels; ++i) {
    rows[i % kCellPx * kTileSizePx + i / kCellPx] = cell[i];
  }
#else
  const hn::CappedTag<T, kCellPx> d;
  const auto x0 = hn::Load(d, cell), x1 = hn::Load(d, cell + kCellPx);
  const auto x2 = hn::Load(d, cell + 2 * kCellPx), x3 = hn::Load(d, cell + 3 * kCellPx);
  const auto low02 = hn::InterleaveLower(d, x0, x2), high02 = hn::InterleaveUpper(d, x0, x2);
  const auto low13 = hn::InterleaveLower(d, x1, x3), high13 = hn::InterleaveUpper(d, x1, x3);
  hn::Store(hn::InterleaveLower(d, low02, low13), d, rows);
  hn::Store(hn::InterleaveUpper(d, low02, low13), d, rows + kTileSizePx);
  hn::Store(hn::InterleaveLower(d, high02, high13), d, rows + 2 * kTileSizePx);
  hn::Store(hn::InterleaveUpper(d, high02, high13), d, rows + 3 * kTileSizePx);
#endif
}

/// Brings a plane from cell order to rows of pixels.
template <class T>
void cells_to_rows(std::array<T, kTilePixels>& plane) {
  alignas(64) const std::array<T, kTilePixels> cells = plane;
  for (std::size_t p = 0; p < kTilePixels; p += kCellPixels) {
    cell_to_rows(&cells[p], &plane[row_major(p)]);
  }
}

/// Field of the records of a vector of slots.
HWY_INLINE V gather_field(const ScreenSurfel* records, hn::Vec<Ints> slots,
                          std::size_t offset_bytes) {
  constexpr int kWords = sizeof(ScreenSurfel) / sizeof(float);
  static_assert(kWords == 16);
  const auto* field = reinterpret_cast<const float*>(records) + offset_bytes / sizeof(float);
  return hn::GatherIndex(Floats(), field, hn::ShiftLeft<4>(slots));
}

/// Depth of a vector of pixels, each of its own surfel, within the disc's range.
/// @param x_px, y_px  Pixel centres.
HWY_INLINE V depth_of(const ScreenSurfel* records, hn::Vec<Ints> slots, V x_px, V y_px) {
  const Floats d;
  const Ints di;
  const auto field = [&](std::size_t offset) { return gather_field(records, slots, offset); };
  const V dx = hn::Sub(x_px, field(offsetof(ScreenSurfel, x0_px)));
  const V dy = hn::Sub(y_px, field(offsetof(ScreenSurfel, y0_px)));
  const V e =
      hn::NegMulAdd(field(offsetof(ScreenSurfel, g0)), dx,
                    hn::NegMulAdd(field(offsetof(ScreenSurfel, g1)), dy, hn::Set(d, 1.0F)));
  V bounded = hn::Min(hn::Max(e, field(offsetof(ScreenSurfel, e_min))),
                      field(offsetof(ScreenSurfel, e_max)));
  const auto shape = hn::BitCast(di, field(offsetof(ScreenSurfel, shape)));
  const auto is = [&](SurfelShape which) {
    return hn::RebindMask(d, hn::Eq(shape, hn::Set(di, static_cast<std::int32_t>(which))));
  };
  bounded = hn::IfThenElse(is(SurfelShape::kInria), e, bounded);
  bounded = hn::IfThenElse(is(SurfelShape::kGsplat), hn::Set(d, 1.0F), bounded);
  return hn::Div(field(offsetof(ScreenSurfel, z0_m)), bounded);
}

/// Median depth of all pixels that have one: looked up once, since what a pixel's surfel is
/// was all that the blend loop had to know.
void find_median_depths(const RasterJob& job, std::span<const std::uint32_t> list, int tile_x,
                        int tile_y, TileState& state) {
  const Floats d;
  const Ints di;
  if (list.empty()) return;
  const V half_tile = hn::Set(d, 0.5F * kTileSizePx);
  for (std::size_t p = 0; p < kTilePixels; p += hn::Lanes(d)) {
    const Lanes at =
        lanes_of(static_cast<int>(p / kCellPixels), static_cast<int>(p % kCellPixels));
    const auto position = hn::BitCast(di, hn::Load(Keys(), &state.front[p]));
    const auto slots =
        hn::GatherIndex(di, reinterpret_cast<const std::int32_t*>(list.data()), position);
    const V x_px = hn::Add(hn::Add(at.x, half_tile),
                           hn::Set(d, static_cast<float>(tile_x * kTileSizePx)));
    const V y_px = hn::Add(at.row, hn::Set(d, static_cast<float>(tile_y * kTileSizePx)));
    hn::Store(depth_of(job.projected.screen.data(), slots, x_px, y_px), d, &state.depth[p]);
  }
}

/// Gives all planes in use their final values and order.
template <bool kRgb, bool kNormal>
void finish_planes(const RasterJob& job, std::size_t tile, int key_count, TileState& state) {
  if (job.wants_depth && job.median_depth) {
    const auto index = static_cast<int>(tile);
    find_median_depths(job, job.bins.list(tile), index % job.bins.tiles_x(),
                       index / job.bins.tiles_x(), state);
  }
  cells_to_rows(state.transmittance);
  if (job.wants_depth) cells_to_rows(state.depth);
  if constexpr (kRgb) {
    for (auto* plane : {&state.r, &state.g, &state.b}) cells_to_rows(*plane);
  }
  if constexpr (kNormal) {
    for (auto* plane : {&state.nx, &state.ny, &state.nz}) cells_to_rows(*plane);
  }
  for (int k = 0; k < key_count; ++k) cells_to_rows(state.keys[k]);
}

/// @return  False if the whole tile is finished.
template <bool kRgb, bool kNormal, int kKeys>
bool blend_chunk(const RasterJob& job, const TileChunk& chunk, float y_px,
                 std::uint32_t& live_cells, TileState& state, TileStats& stats) {
  const auto lanes = static_cast<int>(hn::Lanes(Floats()));
  for (std::uint32_t cells = live_cells; cells != 0; cells &= cells - 1) {
    const int cell = std::countr_zero(cells);
    const std::uint64_t todo = surfels_of_cell(chunk, cell);
    if (todo == 0) continue;
    bool live = false;
    for (int first = 0; first < kCellPixels; first += lanes) {
      live |=
          blend_cell<kRgb, kNormal, kKeys>(job, chunk, todo, cell, first, y_px, state, stats);
    }
    if (!live) live_cells &= ~(1U << cell);
  }
  return live_cells != 0;
}

/// Copies the planes in use: a tile waits for its next slab.
template <bool kRgb, bool kNormal>
void copy_state(const RasterJob& job, int key_count, const TileState& from, TileState& to) {
  if (from.window_closed) {
    to = from;
    return;
  }
  to.window_closed = false;
  to.all = from.all;
  to.transmittance = from.transmittance;
  to.running = from.running;
  if (job.wants_depth && job.median_depth) to.front = from.front;
  if (job.wants_depth && !job.median_depth) to.depth = from.depth;
  if constexpr (kRgb) to.r = from.r, to.g = from.g, to.b = from.b;
  if constexpr (kNormal) to.nx = from.nx, to.ny = from.ny, to.nz = from.nz;
  for (int k = 0; k < key_count; ++k) to.keys[k] = from.keys[k];
}

/// Blends list entries from progress.done on.
template <bool kRgb, bool kNormal, int kKeys>
void blend_list(const RasterJob& job, std::size_t tile, int key_count, TileProgress& progress,
                TileState& state, TileStats& stats) {
  const std::span<const std::uint32_t> list = job.bins.list(tile);
  const auto index = static_cast<int>(tile);
  const int tile_x = index % job.bins.tiles_x(), tile_y = index / job.bins.tiles_x();
  TileChunk chunk;
  while (progress.done < list.size() && progress.live_cells != 0) {
    if (progress.done - progress.window == kWindow) {
      if (key_count > 0) {
        for (int k = 0; k < key_count; ++k) cells_to_rows(state.keys[k]);
        close_window(job, list, progress.window, state);
        for (int k = 0; k < key_count; ++k) state.keys[k].fill(0);
      }
      progress.window = progress.done;
    }
    const auto window_list =
        list.first(std::min<std::size_t>(list.size(), std::size_t{progress.window} + kWindow));
    load_chunk(job.projected, window_list, progress.done, tile_x, tile_y, chunk);
    stats.pairs_touched += chunk.count;
    progress.done += chunk.count;
    blend_chunk<kRgb, kNormal, kKeys>(job, chunk, static_cast<float>(tile_y * kTileSizePx),
                                      progress.live_cells, state, stats);
  }
}

template <bool kRgb, bool kNormal, int kKeys>
TileStats raster_tile_with(const RasterJob& job, std::size_t tile, bool last,
                           TileProgress& progress) {
  const int key_count = kKeys == 0 || job.all_surfels ? 0
                        : kKeys == kRegisterKeys      ? kRegisterKeys
                                                      : job.top_k;
  TileState fresh;  // Not initialised: clear_tile() fills what this job uses.
  TileState& state = progress.started ? *progress.state : fresh;
  const bool stays = progress.started;
  if (!progress.started) {
    clear_tile(job, tile, key_count, state);
    progress.done = progress.window = 0;
    const PixelRectangle inside = rectangle_of(job, tile);
    progress.live_cells = cells_inside(inside.width, inside.height);
    progress.started = true;
  }
  TileStats stats;
  blend_list<kRgb, kNormal, kKeys>(job, tile, key_count, progress, state, stats);
  stats.finished = last || progress.live_cells == 0;
  if (stats.finished) {
    finish_planes<kRgb, kNormal>(job, tile, key_count, state);
    stats.feature_fetches = write_tile(job, tile, job.bins.list(tile), progress.window, state);
  } else if (!stays) {
    // NOLINTNEXTLINE(modernize-make-unique): that would clear it, which nobody needs.
    if (!progress.state) progress.state.reset(new TileState);
    copy_state<kRgb, kNormal>(job, key_count, state, *progress.state);
  }
  return stats;
}

template <bool kRgb, bool kNormal>
TileStats raster_tile_keys(const RasterJob& job, std::size_t tile, bool last,
                           TileProgress& progress) {
  if (!job.selects) return raster_tile_with<kRgb, kNormal, 0>(job, tile, last, progress);
  if (job.top_k <= kRegisterKeys && !job.first_hits && !job.all_surfels) {
    return raster_tile_with<kRgb, kNormal, kRegisterKeys>(job, tile, last, progress);
  }
  return raster_tile_with<kRgb, kNormal, kMaxTopK>(job, tile, last, progress);
}

TileStats raster_tile_simd(const RasterJob& job, std::size_t tile, bool last,
                           TileProgress& progress) {
  const bool rgb = core::has(job.channels, core::Channels::kRgb);
  const bool normal = core::has(job.channels, core::Channels::kNormal);
  if (rgb) {
    return normal ? raster_tile_keys<true, true>(job, tile, last, progress)
                  : raster_tile_keys<true, false>(job, tile, last, progress);
  }
  return normal ? raster_tile_keys<false, true>(job, tile, last, progress)
                : raster_tile_keys<false, false>(job, tile, last, progress);
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer::internal
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace segsim::renderer::internal {
namespace {

HWY_EXPORT(raster_tile_simd);

}  // namespace

TileProgress::TileProgress() = default;
TileProgress::~TileProgress() = default;
TileProgress::TileProgress(TileProgress&&) noexcept = default;

TileStats raster_tile(const RasterJob& job, std::size_t tile, bool last,
                      TileProgress& progress) {
  return HWY_DYNAMIC_DISPATCH(raster_tile_simd)(job, tile, last, progress);
}

}  // namespace segsim::renderer::internal
#endif  // HWY_ONCE
