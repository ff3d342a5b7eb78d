#pragma once

/// @file
/// What a block keeps in shared memory while it draws a tile.

#include <cstddef>
#include <cstdint>

#include "renderer/cuda/tile_list.cuh"
#include "renderer/cuda/warp.cuh"
#include "renderer/scene/render_options.h"

namespace segsim::renderer::cuda {

constexpr int kWarps = kTileThreads / kWarp;
static_assert(kWarps == 4 && kTilePixels == 2 * kTileThreads);

/// Of a pixel's Top-K selection; see selection.cuh.
constexpr int kFewKeys = 4;
constexpr int kManyKeys = kMaxTopK;

struct TileShared {
  ListShared list;
  /// Of each warp two groups of records, word by word: one is blended while the other arrives.
  /// The four arrays are one piece of memory once a tile is blended.
  uint4 centre_m0[2][kTileThreads];  ///< x0, y0, m00, m01
  uint4 m1_g[2][kTileThreads];       ///< m10, m11, g0, g1
  uint4 depth[2][kTileThreads];      ///< c_k2, z0, e_min, e_max
  uint4 shade[2][kTileThreads];      ///< Colour and normal as halves; flags.
  static constexpr std::size_t kStagedBytes = 4 * 2 * kTileThreads * sizeof(uint4);
  std::uint32_t ended_bits;
  std::uint32_t evaluations, contributions, fetches;
  int touched;  ///< Entries that the slowest warp has read.
  int tile;
  /// Of few keys: indices in the cloud of what was selected in chunks before, by pixel. Of
  /// many keys the keys themselves, key k of pixel p at k * kTilePixels + p, and the array
  /// goes on as far as the frame's K needs: the last member.
  std::uint32_t selection[kFewKeys * kTilePixels];
};

/// Bytes of a block that selects so many surfels in shared memory.
inline std::size_t shared_bytes(int keys) {
  const std::size_t more = keys > kFewKeys ? keys - kFewKeys : 0;
  return sizeof(TileShared) + sizeof(std::uint32_t) * kTilePixels * more;
}

}  // namespace segsim::renderer::cuda
