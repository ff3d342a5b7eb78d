#include "renderer/raster/tile_state.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>

#include "renderer/raster/tile_cells.h"

namespace segsim::renderer::internal {
namespace {

using core::Channels;
using core::has;

/// Memory of the tiles in progress, kept for later ones. Only renderers that keep all surfels
/// come here, so a lock does no harm.
class AllSurfelsPool {
 public:
  AllSurfels* take() {
    const std::lock_guard lock(mutex_);
    if (free_.empty()) {
      made_.push_back(std::make_unique<AllSurfels>());
      free_.push_back(made_.back().get());
    }
    AllSurfels* all = free_.back();
    free_.pop_back();
    return all;
  }
  void give_back(AllSurfels* all) {
    const std::lock_guard lock(mutex_);
    free_.push_back(all);
  }

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<AllSurfels>> made_;
  std::vector<AllSurfels*> free_;
};

AllSurfelsPool& all_surfels_pool() {
  static AllSurfelsPool pool;
  return pool;
}

/// Surfels that a pixel selected in the windows before and in this one.
/// @return  How many there are, <= resolve.top_k.
int selected_surfels(const ResolveJob& resolve, std::span<const std::uint32_t> list,
                     std::uint32_t window, const TileState& state, std::size_t pixel,
                     std::array<WeightedSlot, 2 * kMaxTopK>& found) {
  std::array<std::uint32_t, kMaxTopK> keys;
  int key_count = 0;
  while (key_count < resolve.top_k && is_key(state.keys[key_count][pixel])) {
    keys[key_count] = state.keys[key_count][pixel];
    ++key_count;
  }
  int count = 0;
  if (state.window_closed) {
    count = state.earlier_count[pixel];
    std::copy_n(state.earlier[pixel].begin(), count, found.begin());
    if (resolve.rule == TopKRule::kFirst) {
      // Of this window's first K only the very first may still find a place.
      std::sort(keys.begin(), keys.begin() + key_count, [](std::uint32_t a, std::uint32_t b) {
        return key_position(a) < key_position(b);
      });
    }
  }
  for (int k = 0; k < key_count; ++k) {
    found[count++] = {key_weight(keys[k]), list[window + key_position(keys[k])]};
  }
  if (state.window_closed && resolve.rule == TopKRule::kHeaviest) {
    std::stable_sort(
        found.begin(), found.begin() + count,
        [](const WeightedSlot& a, const WeightedSlot& b) { return a.weight > b.weight; });
  }
  return std::min(count, resolve.top_k);
}

}  // namespace

PixelRectangle rectangle_of(const RasterJob& job, std::size_t tile) {
  const auto index = static_cast<int>(tile);
  const int tiles_x = (job.frame.intrinsics.width_px + kTileSizePx - 1) / kTileSizePx;
  const int x = index % tiles_x * kTileSizePx;
  const int y = index / tiles_x * kTileSizePx;
  return {x, y, std::min(kTileSizePx, job.frame.intrinsics.width_px - x),
          std::min(kTileSizePx, job.frame.intrinsics.height_px - y)};
}

void clear_tile(const RasterJob& job, std::size_t tile, int key_count, TileState& state) {
  if (job.median_depth) {
    state.front.fill(0);
  } else {
    state.depth.fill(0.0F);
  }
  if (has(job.channels, Channels::kRgb)) {
    for (auto* plane : {&state.r, &state.g, &state.b}) plane->fill(0.0F);
  }
  if (has(job.channels, Channels::kNormal)) {
    for (auto* plane : {&state.nx, &state.ny, &state.nz}) plane->fill(0.0F);
  }
  for (int k = 0; k < key_count; ++k) state.keys[k].fill(0);
  state.window_closed = false;
  state.all = job.all_surfels && job.selects ? all_surfels_pool().take() : nullptr;
  if (state.all != nullptr) {
    state.all->log.clear();
    state.all->sums.assign(job.sums_features ? kTilePixels * kFeatureChannels : 0, 0.0F);
    state.all->rows_read = 0;
  }
  // Whole tiles need not care in which order the pixels are.
  const PixelRectangle at = rectangle_of(job, tile);
  const bool whole = at.width == kTileSizePx && at.height == kTileSizePx;
  state.transmittance.fill(1.0F);
  state.running.fill(whole ? 1.0F : 0.0F);
  for (int y = 0; y < at.height && !whole; ++y) {
    for (int x = 0; x < at.width; ++x) state.running[cell_index(x, y)] = 1.0F;
  }
}

void close_window(const RasterJob& job, std::span<const std::uint32_t> list,
                  std::uint32_t window, TileState& state) {
  const ResolveJob& resolve = *job.resolve;
  if (resolve.top_k == kAllSurfels) return;
  std::array<WeightedSlot, 2 * kMaxTopK> found{};
  for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
    const int count = selected_surfels(resolve, list, window, state, pixel, found);
    std::copy_n(found.begin(), count, state.earlier[pixel].begin());
    state.earlier_count[pixel] = count;
  }
  state.window_closed = true;
  for (int k = 0; k < resolve.top_k; ++k) state.keys[k].fill(0);
}

void select_surfels(const ResolveJob& resolve, std::span<const std::uint32_t> list,
                    std::uint32_t window, const TileState& state, SelectedSurfels& selected) {
  if (resolve.top_k == kAllSurfels) {
    selected.assign(state.all->log, kTilePixels);
    return;
  }
  std::array<WeightedSlot, 2 * kMaxTopK> found{};
  selected.clear();
  for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
    const int count = is_surface(state.transmittance[pixel])
                          ? selected_surfels(resolve, list, window, state, pixel, found)
                          : 0;
    selected.append_pixel({found.data(), static_cast<std::size_t>(count)});
  }
}

void select_surfels(const ResolveJob& resolve, std::span<const std::uint32_t> list,
                    std::uint32_t window, const TileState& state,
                    std::span<const std::uint16_t> pixels, SelectedSurfels& selected) {
  std::array<WeightedSlot, 2 * kMaxTopK> found{};
  selected.clear();
  for (const std::uint16_t pixel : pixels) {
    const int count = selected_surfels(resolve, list, window, state, pixel, found);
    selected.append_pixel({found.data(), static_cast<std::size_t>(count)});
  }
}

void return_all(TileState& state) {
  if (state.all != nullptr) all_surfels_pool().give_back(state.all);
  state.all = nullptr;
}

}  // namespace segsim::renderer::internal
