#include <algorithm>
#include <bit>
#include <cstdint>

#include "reconstruction/rasterizer/internal/plain_tile.h"
#include "reconstruction/rasterizer/internal/training_tile.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruction/rasterizer/internal/forward_tile.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

// clang-format off: each target includes it again.
#include "reconstruction/rasterizer/internal/tile_hit-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace segsim::reconstruction::internal::training {
namespace HWY_NAMESPACE {

/// List entries that are looked at together, a cell at a time.
inline constexpr std::uint32_t kEntriesAtOnce = 64;

/// A run of the list.
struct Run {
  std::uint32_t begin, count;
  std::uint64_t of_cell[kCellsAcross * kCellsAcross];  ///< One bit an entry.
  std::uint16_t reached[kEntriesAtOnce];               ///< One bit a cell.
  alignas(64) float heaviest[kEntriesAtOnce][kCellSize];
};

/// The sums of a vector of pixels, in registers.
struct Sums {
  V transmittance, r, g, b, depth_m, nx, ny, nz, m1, m2, first_inverse_depth, median_m;
  V end;  ///< Bits of integers.
};

HWY_INLINE Sums load_sums(const TileRecord<float>& t, int p) {
  return {load(&t.transmittance[p]),
          load(&t.r[p]),
          load(&t.g[p]),
          load(&t.b[p]),
          load(&t.depth_m[p]),
          load(&t.nx[p]),
          load(&t.ny[p]),
          load(&t.nz[p]),
          load(&t.m1[p]),
          load(&t.m2[p]),
          load(&t.first_inverse_depth[p]),
          load(&t.median_m[p]),
          hn::BitCast(Floats(), hn::Load(hn::RebindToUnsigned<Floats>(), &t.end[p]))};
}

HWY_INLINE void store_sums(const Sums& s, TileRecord<float>& t, int p) {
  const Floats d;
  hn::Store(s.transmittance, d, &t.transmittance[p]);
  hn::Store(s.r, d, &t.r[p]);
  hn::Store(s.g, d, &t.g[p]);
  hn::Store(s.b, d, &t.b[p]);
  hn::Store(s.depth_m, d, &t.depth_m[p]);
  hn::Store(s.nx, d, &t.nx[p]);
  hn::Store(s.ny, d, &t.ny[p]);
  hn::Store(s.nz, d, &t.nz[p]);
  hn::Store(s.m1, d, &t.m1[p]);
  hn::Store(s.m2, d, &t.m2[p]);
  hn::Store(s.first_inverse_depth, d, &t.first_inverse_depth[p]);
  hn::Store(s.median_m, d, &t.median_m[p]);
  const hn::RebindToUnsigned<Floats> du;
  hn::Store(hn::BitCast(du, s.end), du, &t.end[p]);
}

/// Open pixels; finished ones have another `end`.
HWY_INLINE M open_pixels(V end) {
  const Ints di;
  return hn::RebindMask(Floats(), hn::Eq(hn::BitCast(di, end),
                                         hn::Set(di, static_cast<std::int32_t>(kOpenPixel))));
}

/// blend_hit() for a vector of pixels.
/// @return  Weights; 0 where nothing was blended.
HWY_INLINE V blend(const DrawnSurfel<float>& s, const Hits& h, std::uint32_t entry, M& open,
                   Sums& sums) {
  const Floats d;
  const Ints di;
  const V zero = hn::Zero(d);
  const V product = hn::Mul(sums.transmittance, h.alpha);
  const V left = hn::Sub(sums.transmittance, product);
  const M met = hn::And(h.hit, open);
  const M goes_on = hn::Ge(left, set(renderer::kStopTransmittance));
  const M blended = hn::And(met, goes_on);
  const M stopped = hn::AndNot(goes_on, met);
  if (!none(stopped)) {
    open = hn::AndNot(stopped, open);
    const V now = hn::BitCast(d, hn::Set(di, static_cast<std::int32_t>(entry)));
    sums.end = hn::IfThenElse(stopped, now, sums.end);
  }
  const V w = hn::IfThenElseZero(blended, product);
  const V depth_m = hn::Mul(set(s.z0_m), h.inverse_e);
  const V inverse_depth = hn::Mul(h.e_drawn, set(1.0F / s.z0_m));
  const V half = set(1.0F - renderer::kMinSurfaceAlpha);
  const M median =
      hn::And(blended, hn::And(hn::Gt(sums.transmittance, half), hn::Le(left, half)));
  sums.median_m = hn::IfThenElse(median, depth_m, sums.median_m);
  const M first = hn::And(blended, hn::Eq(sums.first_inverse_depth, zero));
  sums.first_inverse_depth = hn::IfThenElse(first, inverse_depth, sums.first_inverse_depth);
  sums.transmittance = hn::IfThenElse(blended, left, sums.transmittance);
  const V m = hn::Mul(set(static_cast<float>(kDistortionScale)),
                      hn::Sub(sums.first_inverse_depth, inverse_depth));
  const V wm = hn::Mul(w, m);
  sums.m1 = hn::Add(sums.m1, wm);
  sums.m2 = hn::MulAdd(wm, m, sums.m2);
  sums.r = hn::MulAdd(w, set(s.colour.x), sums.r);
  sums.g = hn::MulAdd(w, set(s.colour.y), sums.g);
  sums.b = hn::MulAdd(w, set(s.colour.z), sums.b);
  sums.depth_m = hn::MulAdd(w, depth_m, sums.depth_m);
  sums.nx = hn::MulAdd(w, set(s.normal.x), sums.nx);
  sums.ny = hn::MulAdd(w, set(s.normal.y), sums.ny);
  sums.nz = hn::MulAdd(w, set(s.normal.z), sums.nz);
  return w;
}

/// Blends a run into the pixels of one vector.
/// @return  False if all of them are finished.
HWY_INLINE bool blend_run(const TileView<float>& tile, const PixelCentres& centres, int cell,
                          int p, Run& run, TileRecord<float>& record) {
  const Floats d;
  Sums sums = load_sums(record, p);
  M open = open_pixels(sums.end);
  if (none(open)) return false;
  const V x_px = load(&centres.x_px[p]), y_px = load(&centres.y_px[p]);
  for (std::uint64_t left = run.of_cell[cell]; left != 0; left &= left - 1) {
    const auto i = static_cast<std::uint32_t>(std::countr_zero(left));
    const DrawnSurfel<float>& s = tile.surfels[tile.list[run.begin + i]].drawn;
    const Hits h = meet(s, x_px, y_px);
    if (none(hn::And(h.hit, open))) continue;
    const V w = blend(s, h, run.begin + i, open, sums);
    hn::Store(hn::Max(w, load(run.heaviest[i])), d, run.heaviest[i]);
    if (!none(hn::Gt(w, hn::Zero(d)))) {
      run.reached[i] = static_cast<std::uint16_t>(run.reached[i] | 1U << cell);
    }
    if (none(open)) break;
  }
  store_sums(sums, record, p);
  return !none(open);
}

HWY_INLINE void begin_run(const TileView<float>& tile, std::uint32_t begin, Run& run) {
  run.begin = begin;
  run.count = std::min(kEntriesAtOnce, static_cast<std::uint32_t>(tile.list.size()) - begin);
  std::fill(std::begin(run.of_cell), std::end(run.of_cell), 0);
  for (std::uint32_t i = 0; i < run.count; ++i) {
    prefetch(tile, begin + i + kAhead);
    run.reached[i] = 0;
    std::fill_n(run.heaviest[i], kCellSize, 0.0F);
    const unsigned cells = cells_in_reach(tile, tile.surfels[tile.list[begin + i]]);
    for (unsigned left = cells; left != 0; left &= left - 1) {
      run.of_cell[std::countr_zero(left)] |= std::uint64_t{1} << i;
    }
  }
}

void forward(const TileView<float>& tile, TileRecord<float>& record, std::uint16_t* cells,
             float* max_weight) {
  for (auto* plane :
       {&record.r, &record.g, &record.b, &record.depth_m, &record.nx, &record.ny, &record.nz,
        &record.m1, &record.m2, &record.first_inverse_depth, &record.median_m}) {
    plane->fill(0.0F);
  }
  record.transmittance.fill(1.0F);
  const PixelCentres centres(tile.x_px, tile.y_px);
  const int step = static_cast<int>(hn::Lanes(Floats()));
  Run run;
  const auto size = static_cast<std::uint32_t>(tile.list.size());
  unsigned open_cells = (1U << (kCellsAcross * kCellsAcross)) - 1U;
  std::uint32_t begin = 0;
  for (; begin < size && open_cells != 0; begin += kEntriesAtOnce) {
    begin_run(tile, begin, run);
    for (unsigned left = open_cells; left != 0; left &= left - 1) {
      const int cell = std::countr_zero(left);
      bool open = false;
      for (int p = cell * kCellSize; p < (cell + 1) * kCellSize; p += step) {
        open = blend_run(tile, centres, cell, p, run, record) || open;
      }
      if (!open) open_cells &= ~(1U << cell);
    }
    for (std::uint32_t i = 0; i < run.count; ++i) {
      cells[begin + i] = run.reached[i];
      if (max_weight == nullptr || run.reached[i] == 0) continue;
      raise(max_weight[tile.list[begin + i]],
            *std::max_element(run.heaviest[i], run.heaviest[i] + step));
    }
  }
  if (begin < size) std::fill(cells + begin, cells + size, std::uint16_t{0});
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::reconstruction::internal::training
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace segsim::reconstruction::internal {
namespace training {
namespace {
HWY_EXPORT(forward);

void forward_of_processor(const TileView<float>& tile, TileRecord<float>& record,
                          std::uint16_t* cells, float* max_weight) {
  HWY_DYNAMIC_DISPATCH(forward)(tile, record, cells, max_weight);
}
}  // namespace
}  // namespace training

void forward_tile(const TileView<float>& tile, TileRecord<float>& record, std::uint16_t* cells,
                  float* max_weight) {
  training::forward_of_processor(tile, record, cells, max_weight);
}

void forward_tile(const TileView<double>& tile, TileRecord<double>& record,
                  std::uint16_t* cells, double* max_weight) {
  plain_forward_tile(tile, record, cells, max_weight);
}

}  // namespace segsim::reconstruction::internal
#endif  // HWY_ONCE
