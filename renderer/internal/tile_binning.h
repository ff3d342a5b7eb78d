#pragma once

/// @file
/// Which surfels each tile must look at, nearest first. Lists grow slab by slab, for tiles
/// that still want more.

#include <cstdint>
#include <span>
#include <vector>

#include "renderer/internal/projection.h"
#include "renderer/internal/tile_size.h"

namespace segsim::renderer::internal {

/// Lists of slots of ProjectedSurfels. Under TileBounds::kAccuTile a slot is in a tile's list
/// exactly if the row interval of its outline (AccuTile of Hanson et al. 2025, on the exact
/// conic) meets the tile. Lists are in order of centre depth, ties by index in the cloud, for
/// any number of threads and however the scene is cut into slabs.
class TileBins {
 public:
  /// Empties the lists; all tiles are live.
  void begin(int width_px, int height_px);

  /// Appends to the lists of the live tiles: surfels of visible clusters [begin, end), and
  /// those left over from earlier slabs, whose depth is below `bound_m`. The others wait.
  /// @param bound_m  No cluster that is still to come holds a nearer centre.
  void add_slab(const ProjectedSurfels& projected, std::size_t begin, std::size_t end,
                float bound_m, Workers& workers);

  /// The tile wants no more surfels.
  void retire(std::size_t tile) { live_[tile] = 0; }
  [[nodiscard]] bool is_live(std::size_t tile) const { return live_[tile] != 0; }

  [[nodiscard]] int tiles_x() const { return tiles_x_; }
  [[nodiscard]] int tiles_y() const { return tiles_y_; }
  [[nodiscard]] std::size_t tile_count() const { return live_.size(); }
  [[nodiscard]] std::span<const std::uint32_t> list(std::size_t tile) const {
    return {slots_.data() + first_[tile], first_[tile + 1] - first_[tile]};
  }
  /// Pairs of all slabs of this frame.
  [[nodiscard]] std::uint64_t pair_count() const { return pair_count_; }

 private:
  /// A surfel of the slab, in order of depth.
  struct Entry {
    const TileSpan* spans;
    std::uint32_t slot;
    std::uint16_t y_begin, y_end;
  };

  void select(const ProjectedSurfels& projected, std::size_t begin, std::size_t end,
              float bound_m);
  void sort_by_depth(const ProjectedSurfels& projected);
  void count_band(int y_begin, int y_end);
  void fill_band(int y_begin, int y_end);
  void place_lists();

  int tiles_x_ = 0, tiles_y_ = 0;
  std::uint64_t pair_count_ = 0;
  std::vector<std::uint8_t> live_;
  std::vector<std::uint32_t> waiting_, still_waiting_;  ///< Slots beyond the bound.
  std::vector<std::uint32_t> keys_, keys_scratch_, order_, order_scratch_;
  std::vector<Entry> entries_;
  std::vector<std::uint32_t> next_;  ///< Per tile: pairs of the slab; then where to write.
  std::vector<std::uint32_t> first_, slots_, first_before_, slots_before_;
};

}  // namespace segsim::renderer::internal
