#include <array>
#include <cstdint>

#include "reconstruction/rasterizer/internal/training_tile.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruction/rasterizer/internal/weigh_cell.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

// clang-format off: each target includes it again.
#include "reconstruction/rasterizer/internal/tile_hit-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace segsim::reconstruction::internal::training {
namespace HWY_NAMESPACE {

/// Adds what each surfel weighs in one vector of the cell, from pixel `first` of the cell on.
void weigh_pixels(const TileView<float>& tile, const TileRecord<float>& record,
                  const PixelCentres& centres, int cell, int first, CellWeights<float>& out) {
  const Floats d;
  const Ints di;
  const int p = cell * kCellSize + first;
  const V x_px = load(&centres.x_px[p]), y_px = load(&centres.y_px[p]);
  const auto end = hn::BitCast(di, hn::Load(hn::RebindToUnsigned<Floats>(), &record.end[p]));
  V transmittance = set(1.0F);
  for (std::size_t k = 0; k < out.entries.size(); ++k) {
    const std::uint32_t entry = out.entries[k];
    const Hits h = meet(tile.surfels[tile.list[entry]].drawn, x_px, y_px);
    const M open =
        hn::RebindMask(d, hn::Lt(hn::Set(di, static_cast<std::int32_t>(entry)), end));
    const V product =
        hn::IfThenElseZero(hn::And(h.hit, open), hn::Mul(transmittance, h.alpha));
    hn::StoreU(product, d, &out.weights[k][static_cast<std::size_t>(first)]);
    transmittance = hn::Sub(transmittance, product);
  }
}

void weigh(const TileView<float>& tile, const TileRecord<float>& record, int cell,
           CellWeights<float>& out) {
  const PixelCentres centres(tile.x_px, tile.y_px);
  const int step = static_cast<int>(hn::Lanes(Floats()));
  for (int first = 0; first < kCellSize; first += step) {
    weigh_pixels(tile, record, centres, cell, first, out);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::reconstruction::internal::training
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace segsim::reconstruction::internal {
namespace training {
namespace {

HWY_EXPORT(weigh);

template <class Real>
void find_entries(const TileView<Real>& tile, const std::uint16_t* cells, int cell,
                  CellWeights<Real>& out) {
  out.entries.clear();
  for (std::uint32_t i = 0; i < tile.list.size(); ++i) {
    if ((cells[i] >> cell & 1U) != 0) out.entries.push_back(i);
  }
  out.weights.resize(out.entries.size());
}

void weigh_on_processor(const TileView<float>& tile, const TileRecord<float>& record, int cell,
                        CellWeights<float>& out) {
  HWY_DYNAMIC_DISPATCH(weigh)(tile, record, cell, out);
}
}  // namespace
}  // namespace training

void weigh_cell(const TileView<float>& tile, const TileRecord<float>& record,
                const std::uint16_t* cells, int cell, CellWeights<float>& out) {
  training::find_entries(tile, cells, cell, out);
  training::weigh_on_processor(tile, record, cell, out);
}

void weigh_cell(const TileView<double>& tile, const TileRecord<double>& record,
                const std::uint16_t* cells, int cell, CellWeights<double>& out) {
  training::find_entries(tile, cells, cell, out);
  std::array<double, kCellSize> transmittance;
  transmittance.fill(1.0);
  for (std::size_t k = 0; k < out.entries.size(); ++k) {
    const DrawnSurfel<double>& s = tile.surfels[tile.list[out.entries[k]]].drawn;
    for (int pixel = 0; pixel < kCellSize; ++pixel) {
      const auto p = static_cast<std::size_t>(pixel);
      const int x = tile.x_px + cell % kCellsAcross * kCellSidePx + pixel % kCellSidePx;
      const int y = tile.y_px + cell / kCellsAcross * kCellSidePx + pixel / kCellSidePx;
      const std::uint32_t end = record.end[static_cast<std::size_t>(cell * kCellSize + pixel)];
      SurfelHit<double> hit;
      const bool blended = out.entries[k] < end && meet_surfel(s, x + 0.5, y + 0.5, hit);
      const double weight = blended ? transmittance[p] * hit.alpha : 0.0;
      out.weights[k][p] = weight;
      transmittance[p] -= weight;
    }
  }
}

}  // namespace segsim::reconstruction::internal
#endif  // HWY_ONCE
