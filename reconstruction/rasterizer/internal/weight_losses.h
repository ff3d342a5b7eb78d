#pragma once

/// @file
/// Losses of blending weights until backward() asks for them, tile by tile.

#include <bit>
#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "core/check.h"
#include "reconstruction/rasterizer/internal/training_tile.h"

namespace segsim::reconstruction::internal {

/// The row of a pixel, front to back.
struct WeightLossRow {
  const std::int32_t* surfel;
  const float *weight, *by_weight;
  std::int32_t entries;
};

template <class Real>
class WeightLosses {
 public:
  void clear() { tiles_.clear(); }

  /// @param place  Of the pixel in the tile.
  void add(std::size_t tile, std::size_t place, const WeightLossRow& row) {
    std::vector<Entry>& entries = tiles_[tile];
    for (std::int32_t e = 0; e < row.entries; ++e) {
      entries.push_back({place, static_cast<std::uint32_t>(row.surfel[e]), e == 0,
                         row.weight[e], row.by_weight[e]});
    }
  }

  /// @param cells  Of each entry of the tile's list, as forward left them.
  /// @return  False if the tile has no such loss.
  bool read(std::size_t tile, const TileView<Real>& view,
            const std::vector<std::uint16_t>& cells, TileWeightLoss<Real>& out) const {
    const auto found = tiles_.find(tile);
    if (found == tiles_.end()) return false;
    std::vector<std::size_t> first_cell(view.list.size() + 1, 0);
    for (std::size_t i = 0; i < view.list.size(); ++i) {
      first_cell[i + 1] = first_cell[i] + static_cast<std::size_t>(std::popcount(cells[i]));
    }
    out.by_weight.assign(kCellSize * first_cell.back(), Real(0));
    out.remaining.fill(Real(0));
    std::size_t at = 0;
    for (const Entry& entry : found->second) {
      if (entry.begins_row) at = 0;
      const std::size_t cell = entry.place / kCellSize;
      const auto is_it = [&](std::size_t i) {
        return view.list[i] == entry.surfel && (cells[i] >> cell & 1U) != 0;
      };
      // Rows and lists are both front to back.
      while (at < view.list.size() && !is_it(at)) ++at;
      SEGSIM_CHECK(at < view.list.size(), "weights of another view");
      const auto before = static_cast<std::uint16_t>(cells[at] & ((1U << cell) - 1U));
      const std::size_t place =
          kCellSize * (first_cell[at] + static_cast<std::size_t>(std::popcount(before))) +
          entry.place % kCellSize;
      out.by_weight[place] += static_cast<Real>(entry.by_weight);
      out.remaining[entry.place] +=
          static_cast<Real>(entry.weight) * static_cast<Real>(entry.by_weight);
      ++at;
    }
    return true;
  }

 private:
  struct Entry {
    std::size_t place;
    std::uint32_t surfel;
    bool begins_row;
    float weight, by_weight;
  };
  std::map<std::size_t, std::vector<Entry>> tiles_;
};

}  // namespace segsim::reconstruction::internal
