#pragma once

/// @file
/// Which surfels each tile must look at, nearest first. Lists grow slab by slab, for tiles
/// that still want more.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "renderer/raster/tile_size.h"

namespace segsim::renderer::internal {

struct SurfelShade;

/// Bits of the centre's depth, which sort like it, above the slot in ProjectedSurfels.
using DepthSlot = std::uint64_t;

/// Tiles [x_begin, x_end) x [y_begin, y_end) of the image.
struct TileBox {
  std::uint16_t x_begin, x_end, y_begin, y_end;
};

/// A thread's entries, by tile: chains of blocks, so that one pass over the surfels suffices
/// and no thread waits for another.
class TileWriter {
 public:
  /// Empties it. @param live  One byte a tile: entries of tiles with 0 are dropped.
  void begin(const std::uint8_t* live, std::size_t tile_count, int tiles_x);

  /// False if all entries for the box would be dropped.
  [[nodiscard]] bool wants_any(const TileBox& box) const {
    for (std::size_t y = box.y_begin; y < box.y_end; ++y) {
      const std::uint8_t* row = live_ + y * tiles_x_;
      if (std::find(row + box.x_begin, row + box.x_end, 1) != row + box.x_end) return true;
    }
    return false;
  }

  /// Tiles [x_begin, x_end) of tile row y.
  void add_row(int y, int x_begin, int x_end, DepthSlot entry) {
    const std::size_t row = static_cast<std::size_t>(y) * tiles_x_;
    for (std::size_t tile = row + x_begin; tile < row + x_end; ++tile) {
      if (live_[tile] != 0) add(tile, entry);
    }
  }

  [[nodiscard]] std::size_t count(std::size_t tile) const { return chains_[tile].count; }
  [[nodiscard]] std::size_t total() const { return total_; }
  void append_to(std::size_t tile, std::vector<DepthSlot>& entries) const;

 private:
  static constexpr std::uint32_t kBlockSize = 16;
  struct alignas(64) Block {
    std::array<DepthSlot, kBlockSize> entries;
  };
  struct Chain {
    std::uint32_t block = 0, count = 0;  ///< Newest block; entries in all.
  };

  void add(std::size_t tile, DepthSlot entry) {
    Chain& chain = chains_[tile];
    const std::uint32_t place = chain.count % kBlockSize;
    if (place == 0) add_block(chain);
    blocks_[chain.block].entries[place] = entry;
    ++chain.count;
    ++total_;
  }
  void add_block(Chain& chain);

  std::vector<Chain> chains_;
  std::vector<Block> blocks_;
  std::vector<std::uint32_t> older_;  ///< Block before a block of the same chain.
  std::uint32_t used_ = 0;
  std::size_t total_ = 0;
  const std::uint8_t* live_ = nullptr;
  std::size_t tiles_x_ = 0;
};

/// Lists of slots of ProjectedSurfels. Under TileBounds::kAccuTile a slot is in a tile's list
/// exactly if the row interval of its outline (AccuTile of Hanson et al. 2025, on the exact
/// conic) meets the tile. Lists are in order of centre depth, ties by index in the cloud, for
/// any number of threads and however the scene is cut into slabs.
class TileBins {
 public:
  /// Empties the lists; all tiles are live.
  void begin(int width_px, int height_px, int thread_count);

  /// A slab begins: the writers are empty, and want entries of live tiles only.
  void open_slab();
  /// @param thread  Below thread_count.
  [[nodiscard]] TileWriter& writer(int thread) { return writers_[thread]; }
  /// The slab's surfels are written: takes note of how many there are.
  void close_slab();

  /// Moves the slab's entries to the tile. To be called once a slab for every live tile, by
  /// any thread.
  void collect(std::size_t tile);
  /// Appends to the tile's list what it waits for and is nearer than `bound_m`; the rest goes
  /// on waiting, since a later slab may hold nearer ones. After collect(), by any thread.
  /// @param shade  Names the index in the cloud of a slot; null if slots are in that order.
  void extend_list(std::size_t tile, float bound_m, const SurfelShade* shade);
  /// The tile wants no more.
  void retire(std::size_t tile) { live_[tile] = 0; }

  [[nodiscard]] bool is_live(std::size_t tile) const { return live_[tile] != 0; }
  [[nodiscard]] std::size_t tile_count() const { return live_.size(); }
  [[nodiscard]] int tiles_x() const { return tiles_x_; }
  [[nodiscard]] std::span<const std::uint32_t> list(std::size_t tile) const {
    return tiles_[tile].list;
  }
  /// Entries that are not in the list yet; between close_slab() and collect(), those that the
  /// writers hold count too.
  [[nodiscard]] std::size_t waiting(std::size_t tile) const;
  /// Entries written since begin().
  [[nodiscard]] std::size_t pair_count() const { return pair_count_; }

 private:
  struct Tile {
    std::vector<std::uint32_t> list;
    std::vector<DepthSlot> waiting;
  };

  int tiles_x_ = 0;
  std::size_t pair_count_ = 0;
  std::vector<std::uint8_t> live_;
  std::vector<Tile> tiles_;
  std::vector<TileWriter> writers_;
};

}  // namespace segsim::renderer::internal
