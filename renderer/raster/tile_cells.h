#pragma once

/// @file
/// A tile's cells of 4 x 4 pixels, and its surfels while they are in the first-level cache.

#include <algorithm>
#include <cstdint>

#include "renderer/raster/projection.h"
#include "renderer/raster/tile_binning.h"
#include "renderer/raster/tile_state.h"

namespace segsim::renderer::internal {

/// What one vector of 16 lanes blends. Pixel (x, y) of a cell is its entry 4 x + y, so that
/// four rows' values, loaded once, serve all columns. Cell (x, y) of a tile is number 4 x + y.
inline constexpr int kCellPx = 4;
inline constexpr int kCellPixels = kCellPx * kCellPx;
inline constexpr int kCellsPerRow = kTileSizePx / kCellPx;

/// List entries that are prepared together: their rows fit in the first-level cache.
inline constexpr std::uint32_t kChunk = 64;

inline constexpr float kLog2E = 1.44269504F;

/// Column and row of a cell's entry.
alignas(64) inline constexpr float kLaneColumn[kCellPixels] = {0, 0, 0, 0, 1, 1, 1, 1,
                                                               2, 2, 2, 2, 3, 3, 3, 3};
alignas(64) inline constexpr float kLaneRow[kCellPixels] = {0, 1, 2, 3, 0, 1, 2, 3,
                                                            0, 1, 2, 3, 0, 1, 2, 3};

/// Pixel y * kTileSizePx + x of entry `p` of the planes in cell order.
[[nodiscard]] constexpr std::size_t row_major(std::size_t p) {
  const std::size_t cell = p / kCellPixels, entry = p % kCellPixels;
  const std::size_t x = cell / kCellsPerRow * kCellPx + entry / kCellPx;
  const std::size_t y = cell % kCellsPerRow * kCellPx + entry % kCellPx;
  return y * kTileSizePx + x;
}

/// Cells with a pixel in the tile's first `width` columns and `height` rows.
[[nodiscard]] constexpr std::uint32_t cells_inside(int width, int height) {
  const unsigned rows = (1U << (height + kCellPx - 1) / kCellPx) - 1U;
  unsigned cells = 0;
  for (int x = 0; x < width; x += kCellPx) cells |= rows << x;
  return cells;
}

/// Entry of the planes in cell order of pixel (x, y) of the tile.
[[nodiscard]] constexpr std::size_t cell_index(int x, int y) {
  const int cell = x / kCellPx * kCellsPerRow + y / kCellPx;
  return static_cast<std::size_t>(cell * kCellPixels + x % kCellPx * kCellPx + y % kCellPx);
}

enum class PairKind : std::uint32_t {
  kPlain,         ///< P is a parabola.
  kExact,         ///< P from e; p0 holds e in the middle column.
  kThinParabola,  ///< The same two with low pass.
  kThinExact,
  kCare,  ///< Everything from the ScreenSurfel: near plane, edge-on, compat.
};

/// A surfel in a tile; see tile_chunk-inl.h for the symbols.
struct alignas(64) TilePair {
  float a, g0, c_k2, dx, low_pass_b;
  PairKind kind;
  std::uint32_t list_position, key_position;  ///< The latter as keys hold it.
  SurfelShade shade;
  alignas(64) float b[kTileSizePx], c[kTileSizePx];
  float p0[kTileSizePx], p1[kTileSizePx], p2[kTileSizePx];
  float low_pass_c[kTileSizePx];
};

struct TileChunk {
  TilePair pair[kChunk];
  alignas(64) std::uint16_t cells[kChunk];  ///< Bit 4 x + y: the surfel reaches that cell.
  const ScreenSurfel* screen[kChunk];
  std::uint32_t slot[kChunk];
  std::uint32_t count = 0;
};

/// @param rows  Bit 16 g + y: row y reaches column group g.
[[nodiscard]] inline std::uint16_t cells_of_rows(std::uint64_t rows) {
  rows |= rows >> 1U;
  rows |= rows >> 2U;
  rows &= 0x1111111111111111U;
  // Bits 0, 4, 8, 12 of every 16 to bits 9 ... 12, then the four nibbles to bits 48 ... 63; no
  // two terms of the products meet.
  rows = rows * 0x249U >> 9U & 0x000F000F000F000FU;
  return static_cast<std::uint16_t>(rows * 0x0001001001001000U >> 48U);
}

/// Cells that the surfel's pixel rectangle meets.
[[nodiscard]] inline std::uint16_t cells_of_rectangle(const ScreenSurfel& s, int tile_x,
                                                      int tile_y) {
  const auto in_tile = [](int pixel) {
    return std::clamp(pixel, 0, kTileSizePx - 1) / kCellPx;
  };
  const int x0 = tile_x * kTileSizePx, y0 = tile_y * kTileSizePx;
  const unsigned rows = (2U << in_tile(s.y_hi - y0)) - (1U << in_tile(s.y_lo - y0));
  unsigned cells = 0;
  for (int x = in_tile(s.x_lo - x0); x <= in_tile(s.x_hi - x0); ++x) cells |= rows << (4 * x);
  return static_cast<std::uint16_t>(cells);
}

}  // namespace segsim::renderer::internal
