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
///     either     kAllSurfels   accumulate_all(); the keys are not used
///
/// A key names a position in the present window of the tile's list. Before positions start
/// anew (a long list, or a later part of the scene), close_window() puts the keys aside; slots
/// must keep their meaning until write_tile().

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "renderer/internal/label_resolve.h"
#include "renderer/internal/tile_raster.h"
#include "renderer/internal/tile_resolve.h"

namespace segsim::renderer::internal {

inline constexpr std::size_t kTilePixels =
    static_cast<std::size_t>(kTileSizePx) * static_cast<std::size_t>(kTileSizePx);

/// A key holds a weight in its upper 20 bits (a float without the last 12 bits of its
/// fraction, so 5e-4 relative) and a list position in the lower 12; larger keys are heavier.
/// A key without weight is no key, whatever its position.
inline constexpr std::uint32_t kKeyPositionMask = 0xFFF;
/// List positions that one set of keys can tell apart. Longer lists are taken in windows.
inline constexpr std::uint32_t kWindow = kKeyPositionMask + 1;

/// All surfels of all pixels of a tile, in the order in which they were blended.
using CandidateLog = std::vector<SelectedSurfels::Entry>;

/// Entry of every plane that belongs to pixel (x, y) of the tile.
[[nodiscard]] constexpr std::size_t plane_index(int x, int y) {
  return static_cast<std::size_t>(y * kTileSizePx + x);
}

struct TileState {
  using Plane = std::array<float, kTilePixels>;

  alignas(64) Plane transmittance;
  alignas(64) Plane live;  ///< 1 until the pixel is finished; 0 outside the image.
  alignas(64) Plane r, g, b;
  alignas(64) Plane depth;  ///< Sum of weight * depth, or the median depth so far [m].
  alignas(64) Plane nx, ny, nz;
  /// Selected surfels of the present window; see the table above.
  alignas(64) std::array<std::array<std::uint32_t, kTilePixels>, kMaxTopK> keys;
  /// Selected surfels of the windows before; in use once a window was closed.
  std::array<std::array<WeightedSlot, kMaxTopK>, kTilePixels> earlier;
  std::array<int, kTilePixels> earlier_count;
  bool window_closed;
  /// Lent from clear_tile() to write_tile() if all surfels count, so that a tile may wait and
  /// go on in another thread; else null.
  CandidateLog* log;
};

/// Remembers a surfel of a pixel when all of them count. @param weight  > 0.
inline void accumulate_all(TileState& state, std::size_t pixel, float weight,
                           std::uint32_t slot) {
  state.log->push_back({weight, slot, static_cast<std::uint32_t>(pixel)});
}
/// The same for `count` pixels from `first_pixel` on; weights of 0 are left out.
inline void accumulate_all(TileState& state, std::size_t first_pixel, const float* weights,
                           std::size_t count, std::uint32_t slot) {
  for (std::size_t i = 0; i < count; ++i) {
    if (weights[i] > 0.0F) accumulate_all(state, first_pixel + i, weights[i], slot);
  }
}

/// Empties the parts that the job needs.
/// @param key_count  Planes of keys in use; 0 if none are or all surfels count.
void clear_tile(const RasterJob& job, std::size_t tile, int key_count, TileState& state);

/// Moves the keys of the window that starts at list position `window` to `earlier`, and
/// empties them.
void close_window(const RasterJob& job, std::span<const std::uint32_t> list,
                  std::uint32_t window, TileState& state);

/// Finishes the pixels and writes them to the images of the job's channels. Labels and
/// features come from job.resolve, which these three need.
/// @return  RenderStats::feature_fetches of the tile: a label for every selected surfel of a
///     pixel; rows of scores and features once for every block of neighbouring pixels.
std::uint64_t write_tile(const RasterJob& job, std::size_t tile,
                         std::span<const std::uint32_t> list, std::uint32_t window,
                         const TileState& state);

}  // namespace segsim::renderer::internal
