#include "renderer/internal/tile_binning.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

namespace segsim::renderer::internal {
namespace {

/// Entries that one task prepares.
constexpr std::size_t kEntriesPerTask = 4096;
constexpr unsigned kRadixBits = 11;
constexpr std::size_t kRadix = std::size_t{1} << kRadixBits;
using Histogram = std::array<std::uint32_t, kRadix>;

/// One stable pass of the radix sort over bits [shift, shift + kRadixBits).
/// @return  False if all keys are equal in these bits: nothing was moved.
bool radix_pass(unsigned shift, const std::vector<std::uint32_t>& keys,
                const std::vector<std::uint32_t>& values, std::vector<std::uint32_t>& keys_out,
                std::vector<std::uint32_t>& values_out) {
  Histogram histogram{};
  for (const std::uint32_t key : keys) ++histogram[key >> shift & (kRadix - 1)];
  std::uint32_t sum = 0;
  for (std::uint32_t& h : histogram) {
    if (h == keys.size()) return false;
    const std::uint32_t count = h;
    h = sum;
    sum += count;
  }
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const std::uint32_t to = histogram[keys[i] >> shift & (kRadix - 1)]++;
    keys_out[to] = keys[i];
    values_out[to] = values[i];
  }
  return true;
}

}  // namespace

void TileBins::begin(int width_px, int height_px) {
  tiles_x_ = (width_px + kTileSizePx - 1) / kTileSizePx;
  tiles_y_ = (height_px + kTileSizePx - 1) / kTileSizePx;
  const std::size_t tile_count = static_cast<std::size_t>(tiles_x_) * tiles_y_;
  live_.assign(tile_count, 1);
  next_.resize(tile_count);
  first_.assign(tile_count + 1, 0);
  waiting_.clear();
  pair_count_ = 0;
}

void TileBins::select(const ProjectedSurfels& projected, std::size_t begin, std::size_t end,
                      float bound_m) {
  // Positive floats sort like their bits; a bound at or before the camera admits nothing.
  const std::uint32_t bound_key =
      std::bit_cast<std::uint32_t>(bound_m > 0.0F ? bound_m : 0.0F);
  keys_.clear();
  order_.clear();
  still_waiting_.clear();
  const auto take = [&](std::uint32_t slot) {
    const std::uint32_t key = projected.depth_key[slot];
    if (key < bound_key) {
      keys_.push_back(key);
      order_.push_back(slot);
    } else {
      still_waiting_.push_back(slot);
    }
  };
  for (const std::uint32_t slot : waiting_) take(slot);
  for (std::size_t v = begin; v < end; ++v) {
    for (std::uint32_t i = 0; i < projected.count[v]; ++i) {
      take(static_cast<std::uint32_t>(v * kClusterSize + i));
    }
  }
  waiting_.swap(still_waiting_);
}

void TileBins::sort_by_depth(const ProjectedSurfels& projected) {
  keys_scratch_.resize(keys_.size());
  order_scratch_.resize(order_.size());
  for (unsigned shift = 0; shift < 32; shift += kRadixBits) {
    if (radix_pass(shift, keys_, order_, keys_scratch_, order_scratch_)) {
      keys_.swap(keys_scratch_);
      order_.swap(order_scratch_);
    }
  }
  // Runs of equal depth, by index in the cloud.
  for (std::size_t i = 0; i + 1 < keys_.size();) {
    std::size_t end = i + 1;
    while (end < keys_.size() && keys_[end] == keys_[i]) ++end;
    if (end - i > 1) {
      std::sort(order_.begin() + static_cast<std::ptrdiff_t>(i),
                order_.begin() + static_cast<std::ptrdiff_t>(end),
                [&](std::uint32_t a, std::uint32_t b) {
                  return projected.shade[a].surfel < projected.shade[b].surfel;
                });
    }
    i = end;
  }
}

/// Pairs of tile rows [y_begin, y_end).
void TileBins::count_band(int y_begin, int y_end) {
  std::fill(next_.begin() + static_cast<std::ptrdiff_t>(y_begin) * tiles_x_,
            next_.begin() + static_cast<std::ptrdiff_t>(y_end) * tiles_x_, 0U);
  for (const Entry& entry : entries_) {
    const int end = std::min<int>(entry.y_end, y_end);
    for (int y = std::max<int>(entry.y_begin, y_begin); y < end; ++y) {
      const TileSpan span = entry.spans[y - entry.y_begin];
      std::uint32_t* row = next_.data() + static_cast<std::size_t>(y) * tiles_x_;
      for (int x = span.begin; x < span.end; ++x) ++row[x];
    }
  }
}

/// Room for every live tile's list and the slab's pairs behind it.
void TileBins::place_lists() {
  first_before_.swap(first_);
  slots_before_.swap(slots_);
  first_.resize(first_before_.size());
  std::uint32_t sum = 0;
  for (std::size_t tile = 0; tile < live_.size(); ++tile) {
    const std::uint32_t added = next_[tile];
    first_[tile] = sum;
    if (live_[tile] == 0) continue;
    const std::uint32_t present = first_before_[tile + 1] - first_before_[tile];
    next_[tile] = sum + present;
    sum += present + added;
    pair_count_ += added;
  }
  first_[live_.size()] = sum;
  if (slots_.size() < sum) slots_.resize(sum + sum / 4);
}

void TileBins::fill_band(int y_begin, int y_end) {
  for (std::size_t tile = static_cast<std::size_t>(y_begin) * tiles_x_;
       tile < static_cast<std::size_t>(y_end) * tiles_x_; ++tile) {
    if (live_[tile] == 0) continue;
    std::copy(slots_before_.begin() + first_before_[tile],
              slots_before_.begin() + first_before_[tile + 1], slots_.begin() + first_[tile]);
  }
  for (const Entry& entry : entries_) {
    const int end = std::min<int>(entry.y_end, y_end);
    for (int y = std::max<int>(entry.y_begin, y_begin); y < end; ++y) {
      const TileSpan span = entry.spans[y - entry.y_begin];
      const std::size_t row = static_cast<std::size_t>(y) * tiles_x_;
      for (std::size_t tile = row + span.begin; tile < row + span.end; ++tile) {
        if (live_[tile] != 0) slots_[next_[tile]++] = entry.slot;
      }
    }
  }
}

void TileBins::add_slab(const ProjectedSurfels& projected, std::size_t begin, std::size_t end,
                        float bound_m, Workers& workers) {
  select(projected, begin, end, bound_m);
  sort_by_depth(projected);
  entries_.resize(order_.size());
  const std::size_t task_count = (order_.size() + kEntriesPerTask - 1) / kEntriesPerTask;
  workers.for_each(task_count, [&](std::size_t task) {
    const std::size_t last = std::min(order_.size(), (task + 1) * kEntriesPerTask);
    for (std::size_t i = task * kEntriesPerTask; i < last; ++i) {
      const std::uint32_t slot = order_[i];
      const SurfelTiles& tiles = projected.tiles[slot];
      entries_[i] = {projected.spans_of(slot), slot, tiles.y_begin, tiles.y_end};
    }
  });
  // Every band reads all entries, so there are only a few.
  const int bands =
      std::min(tiles_y_, workers.thread_count() == 1 ? 1 : 2 * workers.thread_count());
  const auto band_begin = [&](std::size_t band) {
    return static_cast<int>(band) * tiles_y_ / bands;
  };
  const auto band_count = static_cast<std::size_t>(bands);
  workers.for_each(band_count,
                   [&](std::size_t b) { count_band(band_begin(b), band_begin(b + 1)); });
  place_lists();
  workers.for_each(band_count,
                   [&](std::size_t b) { fill_band(band_begin(b), band_begin(b + 1)); });
}

}  // namespace segsim::renderer::internal
