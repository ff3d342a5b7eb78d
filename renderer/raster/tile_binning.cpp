#include "renderer/raster/tile_binning.h"

#include <algorithm>
#include <bit>

#include <hwy/contrib/sort/vqsort.h>

#include "renderer/raster/projection.h"

namespace segsim::renderer::internal {
namespace {

std::uint32_t depth_bits(DepthSlot entry) { return static_cast<std::uint32_t>(entry >> 32U); }
std::uint32_t slot_of(DepthSlot entry) { return static_cast<std::uint32_t>(entry); }

void sort_entries(std::vector<DepthSlot>& entries) {
  constexpr std::size_t kFew = 32;  // Below, the call costs more than it saves.
  if (entries.size() < kFew) {
    std::sort(entries.begin(), entries.end());
    return;
  }
  thread_local const hwy::Sorter sorter;
  sorter(entries.data(), entries.size(), hwy::SortAscending());
}

/// Brings runs of equal depth into the order of the cloud: slots depend on the camera.
void order_ties(std::span<DepthSlot> entries, const SurfelShade* shade) {
  for (std::size_t i = 0; i + 1 < entries.size(); ++i) {
    if (depth_bits(entries[i]) != depth_bits(entries[i + 1])) continue;
    std::size_t end = i + 2;
    while (end < entries.size() && depth_bits(entries[end]) == depth_bits(entries[i])) ++end;
    std::sort(entries.begin() + static_cast<std::ptrdiff_t>(i),
              entries.begin() + static_cast<std::ptrdiff_t>(end),
              [&](DepthSlot a, DepthSlot b) {
                return shade[slot_of(a)].surfel < shade[slot_of(b)].surfel;
              });
    i = end - 1;
  }
}

}  // namespace

void TileWriter::begin(const std::uint8_t* live, std::size_t tile_count, int tiles_x) {
  chains_.assign(tile_count, {});
  used_ = 0;
  total_ = 0;
  live_ = live;
  tiles_x_ = static_cast<std::size_t>(tiles_x);
}

void TileWriter::add_block(Chain& chain) {
  if (used_ == blocks_.size()) {
    const std::size_t size = std::max<std::size_t>(1024, blocks_.size() * 2);
    blocks_.resize(size);
    older_.resize(size);
  }
  older_[used_] = chain.block;
  chain.block = used_++;
}

void TileWriter::append_to(std::size_t tile, std::vector<DepthSlot>& entries) const {
  std::uint32_t left = chains_[tile].count;
  for (std::uint32_t block = chains_[tile].block; left > 0; block = older_[block]) {
    // Only the newest block may be part full.
    const std::uint32_t here = (left - 1) % kBlockSize + 1;
    const auto first = blocks_[block].entries.begin();
    entries.insert(entries.end(), first, first + here);
    left -= here;
  }
}

void TileBins::begin(int width_px, int height_px, int thread_count) {
  tiles_x_ = (width_px + kTileSizePx - 1) / kTileSizePx;
  const int tiles_y = (height_px + kTileSizePx - 1) / kTileSizePx;
  const std::size_t tile_count = static_cast<std::size_t>(tiles_x_) * tiles_y;
  live_.assign(tile_count, 1);
  if (tiles_.size() < tile_count) tiles_.resize(tile_count);
  for (std::size_t tile = 0; tile < tile_count; ++tile) {
    tiles_[tile].list.clear();
    tiles_[tile].waiting.clear();
  }
  writers_.resize(static_cast<std::size_t>(thread_count));
  pair_count_ = 0;
}

void TileBins::open_slab() {
  for (TileWriter& writer : writers_) writer.begin(live_.data(), live_.size(), tiles_x_);
}

void TileBins::close_slab() {
  for (const TileWriter& writer : writers_) pair_count_ += writer.total();
}

std::size_t TileBins::waiting(std::size_t tile) const {
  std::size_t sum = tiles_[tile].waiting.size();
  for (const TileWriter& writer : writers_) sum += writer.count(tile);
  return sum;
}

void TileBins::collect(std::size_t tile) {
  for (const TileWriter& writer : writers_) writer.append_to(tile, tiles_[tile].waiting);
}

void TileBins::extend_list(std::size_t tile, float bound_m, const SurfelShade* shade) {
  auto& [list, waiting] = tiles_[tile];
  sort_entries(waiting);
  // A bound at or before the camera admits nothing.
  const auto bound =
      static_cast<DepthSlot>(std::bit_cast<std::uint32_t>(bound_m > 0.0F ? bound_m : 0.0F))
      << 32U;
  const auto end = std::lower_bound(waiting.begin(), waiting.end(), bound);
  if (shade != nullptr) order_ties({waiting.begin(), end}, shade);
  for (auto entry = waiting.begin(); entry != end; ++entry) list.push_back(slot_of(*entry));
  waiting.erase(waiting.begin(), end);
}

}  // namespace segsim::renderer::internal
