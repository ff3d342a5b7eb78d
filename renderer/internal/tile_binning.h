#pragma once

/// @file
/// Which surfels each tile must look at, nearest first.

#include <cstdint>
#include <span>
#include <vector>

#include "renderer/internal/projection.h"

namespace segsim::renderer::internal {

inline constexpr int kTileSizePx = 16;

/// Lists of slots of ProjectedSurfels. A slot is in a tile's list exactly if the row interval
/// of its outline (AccuTile of Hanson et al. 2025, on the exact conic) meets the tile. Lists
/// are in order of centre depth, ties by index in the cloud, for any number of threads.
class TileBins {
 public:
  void build(const ProjectedSurfels& projected, int width_px, int height_px, Workers& workers);

  [[nodiscard]] int tiles_x() const { return tiles_x_; }
  [[nodiscard]] int tiles_y() const { return tiles_y_; }
  [[nodiscard]] std::span<const std::uint32_t> list(std::size_t tile) const {
    return {slots_.data() + first_[tile], first_[tile + 1] - first_[tile]};
  }
  [[nodiscard]] std::size_t surfel_count() const { return order_.size(); }
  [[nodiscard]] std::size_t pair_count() const { return first_.back(); }

 private:
  /// One surfel's tiles in one tile row.
  struct Span {
    std::uint32_t slot;
    std::uint16_t tile_y, tile_x_begin, tile_x_end;
  };
  struct Chunk {
    std::vector<Span> spans;
    std::vector<std::uint32_t> count;  ///< Per tile; then where the chunk writes next.
  };

  void sort_by_depth(const ProjectedSurfels& projected);
  void find_spans(const ProjectedSurfels& projected, std::size_t chunk);
  void add_surfel(const ProjectedSurfels& projected, std::uint32_t slot, Chunk& chunk) const;
  static void add_span(const Span& span, int tiles_x, Chunk& chunk);

  int tiles_x_ = 0, tiles_y_ = 0;
  std::vector<std::uint32_t> keys_, keys_scratch_, order_, order_scratch_;
  std::vector<Chunk> chunks_;
  std::vector<std::uint32_t> first_, slots_;
};

}  // namespace segsim::renderer::internal
