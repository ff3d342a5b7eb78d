#pragma once

/// @file
/// The passes of training_tile.h, pixel by pixel.

#include <array>
#include <bit>

#include "reconstruction/rasterizer/internal/training_tile.h"

namespace segsim::reconstruction::internal {

template <class Real>
void plain_forward_tile(const TileView<Real>& tile, TileRecord<Real>& record,
                        std::uint16_t* cells, Real* max_weight) {
  std::array<PixelSums<Real>, kRecordPixels> sums{};
  for (std::uint32_t i = 0; i < tile.list.size(); ++i) {
    const ViewSurfel<Real>& s = tile.surfels[tile.list[i]];
    std::uint16_t reached = 0;
    Real heaviest = Real(0);
    for (unsigned left = cells_in_reach(tile, s); left != 0; left &= left - 1) {
      const int cell = std::countr_zero(left);
      for (int k = 0; k < kCellSize; ++k) {
        const auto p = static_cast<std::size_t>(cell * kCellSize + k);
        if (record.end[p] != kOpenPixel) continue;
        const int x = tile.x_px + cell % kCellsAcross * kCellSidePx + k % kCellSidePx;
        const int y = tile.y_px + cell / kCellsAcross * kCellSidePx + k / kCellSidePx;
        SurfelHit<Real> hit;
        if (!meet_surfel(s.drawn, static_cast<Real>(x) + Real(0.5),
                         static_cast<Real>(y) + Real(0.5), hit)) {
          continue;
        }
        const Real weight = blend_hit(s.drawn, hit, sums[p]);
        if (weight < Real(0)) {
          record.end[p] = i;
          continue;
        }
        reached = static_cast<std::uint16_t>(reached | 1U << cell);
        heaviest = renderer::larger(heaviest, weight);
      }
    }
    cells[i] = reached;
    if (max_weight != nullptr && reached != 0) raise(max_weight[tile.list[i]], heaviest);
  }
  for (int p = 0; p < kRecordPixels; ++p) {
    record.set_sums(p, sums[static_cast<std::size_t>(p)]);
  }
}

template <class Real>
void plain_backward_tile(const TileView<Real>& tile, const TileRecord<Real>& record,
                         const std::uint16_t* cells, const TileLoss<Real>& loss,
                         const TileWeightLoss<Real>* weights, LocalGradient<Real>* gradients) {
  std::array<PixelAdjoint<Real>, kRecordPixels> pixels;
  for (int p = 0; p < kRecordPixels; ++p) {
    pixels[static_cast<std::size_t>(p)] = begin_adjoint(loss.at(p), record.sums(p));
    if (weights == nullptr) continue;
    pixels[static_cast<std::size_t>(p)].remaining +=
        weights->remaining[static_cast<std::size_t>(p)];
  }
  std::size_t next_cell = 0;
  for (std::uint32_t i = 0; i < tile.list.size(); ++i) {
    if (cells[i] == 0) continue;
    const DrawnSurfel<Real>& s = tile.surfels[tile.list[i]].drawn;
    LocalGradient<Real> sum;
    for (unsigned left = cells[i]; left != 0; left &= left - 1) {
      const int cell = std::countr_zero(left);
      const std::size_t first = kCellSize * next_cell++;
      for (int k = 0; k < kCellSize; ++k) {
        const auto p = static_cast<std::size_t>(cell * kCellSize + k);
        if (i >= record.end[p]) continue;
        const int x = tile.x_px + cell % kCellsAcross * kCellSidePx + k % kCellSidePx;
        const int y = tile.y_px + cell / kCellsAcross * kCellSidePx + k / kCellSidePx;
        SurfelHit<Real> hit;
        if (!meet_surfel(s, static_cast<Real>(x) + Real(0.5), static_cast<Real>(y) + Real(0.5),
                         hit)) {
          continue;
        }
        const Real by_weight = weights == nullptr
                                   ? Real(0)
                                   : weights->by_weight[first + static_cast<std::size_t>(k)];
        const HitGradient<Real> by = unblend_hit(s, hit, pixels[p], by_weight);
        add_hit_gradient(s, hit, pixels[p].loss, by, sum);
      }
    }
    *gradients++ = sum;
  }
}

}  // namespace segsim::reconstruction::internal
