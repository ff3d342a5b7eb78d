#pragma once

/// @file
/// One tile of the image in training: what the forward pass leaves behind for the backward
/// pass, both passes, and the weights. The passes in double are the formulas of
/// surfel_adjoint.h, pixel by pixel; those in float are the same for a vector of pixels at a
/// time.

#include <array>
#include <atomic>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "reconstruction/rasterizer/internal/view_surfels.h"
#include "reconstruction/rasterizer/surfel_adjoint.h"
#include "renderer/raster/tile_size.h"

namespace segsim::reconstruction::internal {

inline constexpr int kCellSidePx = 4;
inline constexpr int kCellSize = kCellSidePx * kCellSidePx;
inline constexpr int kCellsAcross = renderer::internal::kTileSizePx / kCellSidePx;
inline constexpr int kRecordPixels =
    renderer::internal::kTileSizePx * renderer::internal::kTileSizePx;
/// TileRecord::end of a pixel that is not finished.
inline constexpr std::uint32_t kOpenPixel = std::numeric_limits<std::int32_t>::max();

/// Where pixel (x, y) of a tile is kept: cells of 4 x 4 pixels one after the other, so that
/// vectors of 4, 8 or 16 pixels are compact on the screen.
[[nodiscard]] constexpr int place_in_tile(int x, int y) {
  const int cell = y / kCellSidePx * kCellsAcross + x / kCellSidePx;
  return cell * kCellSize + y % kCellSidePx * kCellSidePx + x % kCellSidePx;
}

/// Final sums of a tile's pixels, as PixelSums.
template <class Real>
struct alignas(64) TileRecord {
  using Plane = std::array<Real, kRecordPixels>;
  Plane transmittance, r, g, b, depth_m, nx, ny, nz, m1, m2, first_inverse_depth, median_m;
  /// List entry at which the pixel was finished. Before the forward pass: kOpenPixel in the
  /// image, 0 outside.
  std::array<std::uint32_t, kRecordPixels> end;

  [[nodiscard]] PixelSums<Real> sums(int place) const {
    const auto p = static_cast<std::size_t>(place);
    return {transmittance[p],
            {r[p], g[p], b[p]},
            depth_m[p],
            {nx[p], ny[p], nz[p]},
            m1[p],
            m2[p],
            first_inverse_depth[p],
            median_m[p]};
  }
  void set_sums(int place, const PixelSums<Real>& s) {
    const auto p = static_cast<std::size_t>(place);
    transmittance[p] = s.transmittance;
    r[p] = s.rgb.x, g[p] = s.rgb.y, b[p] = s.rgb.z;
    depth_m[p] = s.depth_m;
    nx[p] = s.normal.x, ny[p] = s.normal.y, nz[p] = s.normal.z;
    m1[p] = s.m1, m2[p] = s.m2;
    first_inverse_depth[p] = s.first_inverse_depth;
    median_m[p] = s.median_m;
  }
};

/// Derivatives of the loss by a tile's images; 0 outside the image.
template <class Real>
struct alignas(64) TileLoss {
  using Plane = std::array<Real, kRecordPixels>;
  Plane r, g, b, depth_m, alpha, nx, ny, nz, distortion;

  [[nodiscard]] PixelLoss<Real> at(int place) const {
    const auto p = static_cast<std::size_t>(place);
    return {{r[p], g[p], b[p]}, depth_m[p], alpha[p], {nx[p], ny[p], nz[p]}, distortion[p]};
  }
};

/// Derivatives of a loss by what surfels weigh in a tile's pixels, and its first-order value.
template <class Real>
struct TileWeightLoss {
  /// kCellSize for each entry and each cell where it was blended, in the order of both.
  std::vector<Real> by_weight;
  std::array<Real, kRecordPixels> remaining;  ///< Of each pixel: sum of w by_weight.
};

template <class Real>
struct TileView {
  const ViewSurfel<Real>* surfels;
  std::span<const std::uint32_t> list;  ///< Indices of `surfels`, front to back.
  int x_px, y_px;                       ///< First pixel.
};

/// Cells of the tile that the surfel's pixel range meets, one bit each.
template <class Real>
[[nodiscard]] std::uint16_t cells_in_reach(const TileView<Real>& tile,
                                           const ViewSurfel<Real>& s) {
  const auto cell = [](int pixel) {
    return (pixel < 0                                  ? 0
            : pixel >= renderer::internal::kTileSizePx ? renderer::internal::kTileSizePx - 1
                                                       : pixel) /
           kCellSidePx;
  };
  const unsigned columns = (2U << cell(s.x_hi - tile.x_px)) - (1U << cell(s.x_lo - tile.x_px));
  unsigned cells = 0;
  for (int y = cell(s.y_lo - tile.y_px); y <= cell(s.y_hi - tile.y_px); ++y) {
    cells |= columns << (kCellsAcross * y);
  }
  return static_cast<std::uint16_t>(cells);
}

/// Makes `place` at least `value`, from any thread.
template <class Real>
void raise(Real& place, Real value) {
  std::atomic_ref<Real> shared(place);
  Real old = shared.load(std::memory_order_relaxed);
  while (old < value && !shared.compare_exchange_weak(old, value, std::memory_order_relaxed)) {
  }
}

/// Blends the list into the pixels.
/// @param cells  Receives for each list entry the cells where it was blended.
/// @param max_weight  SurfelGradients::max_weight, may be null.
void forward_tile(const TileView<float>& tile, TileRecord<float>& record, std::uint16_t* cells,
                  float* max_weight);
void forward_tile(const TileView<double>& tile, TileRecord<double>& record,
                  std::uint16_t* cells, double* max_weight);

/// Derivatives by the surfels of the list.
/// @param cells, record  As forward left them.
/// @param weights  A further loss; may be null.
/// @param gradients  Receives one for each entry with cells != 0, in the order of the list.
void backward_tile(const TileView<float>& tile, const TileRecord<float>& record,
                   const std::uint16_t* cells, const TileLoss<float>& loss,
                   const TileWeightLoss<float>* weights, LocalGradient<float>* gradients);
void backward_tile(const TileView<double>& tile, const TileRecord<double>& record,
                   const std::uint16_t* cells, const TileLoss<double>& loss,
                   const TileWeightLoss<double>* weights, LocalGradient<double>* gradients);

/// What surfels weigh in the pixels of one cell.
template <class Real>
struct CellWeights {
  std::vector<std::uint32_t> entries;  ///< Of the tile's list, blended somewhere in the cell.
  /// Of each entry, by the pixel's place in the cell; 0 where it was not blended.
  std::vector<std::array<Real, kCellSize>> weights;
};

/// @param cells, record  As forward left them.
void weigh_cell(const TileView<float>& tile, const TileRecord<float>& record,
                const std::uint16_t* cells, int cell, CellWeights<float>& out);
void weigh_cell(const TileView<double>& tile, const TileRecord<double>& record,
                const std::uint16_t* cells, int cell, CellWeights<double>& out);

}  // namespace segsim::reconstruction::internal
