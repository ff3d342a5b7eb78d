#pragma once

/// @file
/// The pixels of one tile while its surfels are blended.

#include <array>
#include <cstdint>
#include <span>

#include "renderer/internal/label_vote.h"
#include "renderer/internal/tile_raster.h"

namespace segsim::renderer::internal {

inline constexpr std::size_t kTilePixels =
    static_cast<std::size_t>(kTileSizePx) * static_cast<std::size_t>(kTileSizePx);

/// A key holds a weight in its upper 20 bits (a float without the last 12 bits of its
/// fraction, so 5e-4 relative) and a list position in the lower 12; larger keys are heavier.
inline constexpr std::uint32_t kKeyPositionMask = 0xFFF;
/// List positions that one set of keys can tell apart. Longer lists are taken in windows.
inline constexpr std::uint32_t kWindow = kKeyPositionMask + 1;

/// Pixel (x, y) of the tile is entry y * kTileSizePx + x of every plane.
struct TileState {
  using Plane = std::array<float, kTilePixels>;

  alignas(64) Plane transmittance;
  alignas(64) Plane live;  ///< 1 until the pixel is finished; 0 outside the image.
  alignas(64) Plane r, g, b;
  alignas(64) Plane depth;  ///< Sum of weight * depth, or the median depth so far [m].
  alignas(64) Plane nx, ny, nz;
  /// Heaviest surfels of the present window, heaviest first.
  alignas(64) std::array<std::array<std::uint32_t, kTilePixels>, kMaxTopK> keys;
  /// Heaviest surfels of the windows before; only in tiles with several windows.
  std::array<std::array<WeightedLabel, kMaxTopK>, kTilePixels> earlier;
  std::array<int, kTilePixels> earlier_count;
};

/// Empties the parts that the job needs.
void clear_tile(const RasterJob& job, std::size_t tile, int key_count, TileState& state);

/// Moves the keys of the window that starts at list position `window` to `earlier`.
void close_window(const RasterJob& job, std::span<const std::uint32_t> list,
                  std::uint32_t window, TileState& state);

/// Finishes the pixels and writes them to the images.
void write_tile(const RasterJob& job, std::size_t tile, std::span<const std::uint32_t> list,
                std::uint32_t window, const TileState& state);

}  // namespace segsim::renderer::internal
