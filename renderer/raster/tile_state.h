#pragma once

/// @file
/// The pixels of one tile while its surfels are blended, and their end: images are written and
/// the selected surfels become labels and features.
///
/// What the blend loop owes to the Top-K selection, if wants_candidates() says so:
///
///     rule       top_k         per (pixel, surfel) with weight > 0
///
///     kHeaviest  1 ... 24      put the key into keys[0 ... K-1], sorted, heaviest first
///
///     kFirst     1 ... 24      the same, but only while keys[K-1] is empty
///
///     either     kAllSurfels   what TileState::all wants; the keys are not used
///
/// A key names a position in the present window of the tile's list. Before positions start
/// anew (a long list, or a later part of the scene), close_window() puts the keys aside; slots
/// must keep their meaning until write_tile().

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "renderer/raster/label_resolve.h"
#include "renderer/raster/selection_key.h"
#include "renderer/raster/tile_raster.h"
#include "renderer/raster/tile_resolve.h"

namespace segsim::renderer::internal {

inline constexpr std::size_t kTilePixels =
    static_cast<std::size_t>(kTileSizePx) * static_cast<std::size_t>(kTileSizePx);

/// What a tile keeps when all surfels of a pixel count.
struct AllSurfels {
  /// For labels: everything, in the order in which it was blended.
  std::vector<SelectedSurfels::Entry> log;
  /// For features: sums of weight * feature, accumulated in place; 16 + 32 of each pixel.
  std::vector<float> sums;
  std::uint64_t rows_read = 0;  ///< For `sums`.
};
inline constexpr std::size_t kFeatureChannels =
    core::kSemanticFeatureSize + core::kInstanceFeatureSize;

/// Entry of every plane that belongs to pixel (x, y) of the tile.
[[nodiscard]] constexpr std::size_t plane_index(int x, int y) {
  return static_cast<std::size_t>(y * kTileSizePx + x);
}

/// Whether a pixel is opaque enough to have depth, normal and labels. @param t  Not negative.
[[nodiscard]] constexpr bool is_surface(float t) { return 1.0F - t >= kMinSurfaceAlpha; }

struct PixelRectangle {
  int x, y;           ///< First pixel in the image.
  int width, height;  ///< Pixels of the tile inside the image.
};
[[nodiscard]] PixelRectangle rectangle_of(const RasterJob& job, std::size_t tile);

struct TileState {
  using Plane = std::array<float, kTilePixels>;

  alignas(64) Plane transmittance;
  alignas(64) Plane running;  ///< The same until the pixel is finished; 0 outside the image.
  alignas(64) Plane r, g, b;
  alignas(64) Plane depth;  ///< Sum of weight * depth [m]; when finished, what is wanted.
  /// List position of the surfel at the median depth.
  alignas(64) std::array<std::uint32_t, kTilePixels> front;
  alignas(64) Plane nx, ny, nz;
  /// Selected surfels of the present window; see the table above.
  alignas(64) std::array<std::array<std::uint32_t, kTilePixels>, kMaxTopK> keys;
  /// Selected surfels of the windows before; in use once a window was closed.
  std::array<std::array<WeightedSlot, kMaxTopK>, kTilePixels> earlier;
  std::array<int, kTilePixels> earlier_count;
  bool window_closed;
  /// Lent from clear_tile() to write_tile() if all surfels count, so that a tile may wait and
  /// go on in another thread; else null.
  AllSurfels* all;
};

/// Empties the parts that the job needs.
/// @param key_count  Planes of keys in use; 0 if none are or all surfels count.
void clear_tile(const RasterJob& job, std::size_t tile, int key_count, TileState& state);

/// Moves the keys of the window that starts at list position `window` to `earlier`, and
/// empties them.
void close_window(const RasterJob& job, std::span<const std::uint32_t> list,
                  std::uint32_t window, TileState& state);

/// Collects the surfels of all surface pixels, heaviest first. Planes are rows of pixels.
void select_surfels(const ResolveJob& resolve, std::span<const std::uint32_t> list,
                    std::uint32_t window, const TileState& state, SelectedSurfels& selected);

/// The same of these pixels only, whether surface or not; not for kAllSurfels.
void select_surfels(const ResolveJob& resolve, std::span<const std::uint32_t> list,
                    std::uint32_t window, const TileState& state,
                    std::span<const std::uint16_t> pixels, SelectedSurfels& selected);

/// Gives back what clear_tile() took.
void return_all(TileState& state);

}  // namespace segsim::renderer::internal
