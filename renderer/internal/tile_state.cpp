#include "renderer/internal/tile_state.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>

namespace segsim::renderer::internal {
namespace {

using core::Channels;
using core::has;

struct TileRectangle {
  int x, y;           ///< First pixel in the image.
  int width, height;  ///< Pixels of the tile inside the image.
};

TileRectangle rectangle_of(const RasterJob& job, std::size_t tile) {
  const auto index = static_cast<int>(tile);
  const int tiles_x = (job.frame.intrinsics.width_px + kTileSizePx - 1) / kTileSizePx;
  const int x = index % tiles_x * kTileSizePx;
  const int y = index / tiles_x * kTileSizePx;
  return {x, y, std::min(kTileSizePx, job.frame.intrinsics.width_px - x),
          std::min(kTileSizePx, job.frame.intrinsics.height_px - y)};
}

/// What a thread keeps from tile to tile, so that none of it is allocated anew.
struct TileScratch {
  SelectedSurfels selected;
  BlockResolver resolver;
  std::array<PixelLabel, kTilePixels> labels;
  std::array<core::SemanticFeature, kTilePixels> semantic_feature;
  std::array<core::InstanceFeature, kTilePixels> instance_feature;
};

TileScratch& scratch_of_thread() {
  thread_local TileScratch scratch;
  return scratch;
}

/// Logs of the tiles in progress, kept for later ones. Only renderers that keep all surfels
/// come here, so a lock does no harm.
class LogPool {
 public:
  CandidateLog* take() {
    const std::lock_guard lock(mutex_);
    if (free_.empty()) {
      logs_.push_back(std::make_unique<CandidateLog>());
      free_.push_back(logs_.back().get());
    }
    CandidateLog* log = free_.back();
    free_.pop_back();
    log->clear();
    return log;
  }
  void give_back(CandidateLog* log) {
    const std::lock_guard lock(mutex_);
    free_.push_back(log);
  }

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<CandidateLog>> logs_;
  std::vector<CandidateLog*> free_;
};

LogPool& log_pool() {
  static LogPool pool;
  return pool;
}

bool is_surface(const TileState& state, std::size_t pixel) {
  return 1.0F - state.transmittance[pixel] >= kMinSurfaceAlpha;
}

/// Surfels that a pixel selected in the windows before and in this one.
/// @return  How many there are, <= resolve.top_k.
int selected_surfels(const ResolveJob& resolve, std::span<const std::uint32_t> list,
                     std::uint32_t window, const TileState& state, std::size_t pixel,
                     std::array<WeightedSlot, 2 * kMaxTopK>& found) {
  std::array<std::uint32_t, kMaxTopK> keys;
  int key_count = 0;
  while (key_count < resolve.top_k && state.keys[key_count][pixel] > kKeyPositionMask) {
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
        return (a & kKeyPositionMask) < (b & kKeyPositionMask);
      });
    }
  }
  for (int k = 0; k < key_count; ++k) {
    found[count++] = {std::bit_cast<float>(keys[k] & ~kKeyPositionMask),
                      list[window + (keys[k] & kKeyPositionMask)]};
  }
  if (state.window_closed && resolve.rule == TopKRule::kHeaviest) {
    std::stable_sort(
        found.begin(), found.begin() + count,
        [](const WeightedSlot& a, const WeightedSlot& b) { return a.weight > b.weight; });
  }
  return std::min(count, resolve.top_k);
}

/// Collects the surfels of all surface pixels.
void select_surfels(const ResolveJob& resolve, std::span<const std::uint32_t> list,
                    std::uint32_t window, const TileState& state, SelectedSurfels& selected) {
  if (resolve.top_k == kAllSurfels) {
    selected.assign(*state.log, kTilePixels);
    return;
  }
  std::array<WeightedSlot, 2 * kMaxTopK> found{};
  selected.clear();
  for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
    const int count = is_surface(state, pixel)
                          ? selected_surfels(resolve, list, window, state, pixel, found)
                          : 0;
    selected.append_pixel({found.data(), static_cast<std::size_t>(count)});
  }
}

/// Labels of one surfel each, straight from the keys: the common case, and a fast one.
std::uint64_t vote_tile(const RasterJob& job, const ResolveJob& resolve,
                        std::span<const std::uint32_t> list, std::uint32_t window,
                        const TileState& state, PixelLabel* labels) {
  const KeyRow keys{state.keys[0].data(), kTilePixels, resolve.top_k,
                    static_cast<int>(kTilePixels)};
  return vote_row(keys, list.data() + window, job.projected.shade.data(), labels);
}

std::uint8_t to_byte(float value) {
  return static_cast<std::uint8_t>(std::clamp(value, 0.0F, 1.0F) * 255.0F + 0.5F);
}

void write_pixel(const RasterJob& job, const TileState& state, std::size_t pixel, int x,
                 int y) {
  core::Frame& frame = job.frame;
  const float alpha = 1.0F - state.transmittance[pixel];
  const bool surface = alpha >= kMinSurfaceAlpha;
  frame.alpha(x, y) = alpha;
  if (has(job.channels, Channels::kRgb)) {
    frame.rgb(x, y) = {to_byte(state.r[pixel]), to_byte(state.g[pixel]),
                       to_byte(state.b[pixel])};
  }
  if (has(job.channels, Channels::kDepth)) {
    const float depth_m = job.median_depth ? state.depth[pixel] : state.depth[pixel] / alpha;
    frame.depth_m(x, y) = surface ? depth_m : std::numeric_limits<float>::quiet_NaN();
  }
  if (has(job.channels, Channels::kNormal)) {
    const glm::vec3 sum(state.nx[pixel], state.ny[pixel], state.nz[pixel]);
    const float length = std::sqrt(sum.x * sum.x + sum.y * sum.y + sum.z * sum.z);
    frame.normal(x, y) = surface && length > 0.0F ? sum / length : glm::vec3(0.0F);
  }
}

void write_label(core::Frame& frame, const PixelLabel& label, int x, int y) {
  frame.semantic(x, y) = label.semantic;
  frame.instance(x, y) = label.instance;
  frame.confidence(x, y) = label.confidence;
  frame.instance_confidence(x, y) = label.instance_confidence;
}

/// Calls body(pixel, x, y) for the tile's pixels inside the image.
template <class Body>
void for_each_pixel(const TileRectangle& at, const Body& body) {
  for (int row = 0; row < at.height; ++row) {
    for (int column = 0; column < at.width; ++column) {
      body(plane_index(column, row), at.x + column, at.y + row);
    }
  }
}

std::uint64_t write_selected(const RasterJob& job, const ResolveJob& resolve,
                             const TileRectangle& at, std::span<const std::uint32_t> list,
                             std::uint32_t window, const TileState& state) {
  TileScratch& scratch = scratch_of_thread();
  const bool labels = has(job.channels, Channels::kLabels);
  const bool labels_known = labels && (resolve.field != nullptr || resolve.labelled);
  const bool features = has(job.channels, Channels::kFeatures);
  const bool features_known =
      features && resolve.cloud != nullptr && resolve.cloud->has_features();
  const bool plain = !features_known && resolve.field == nullptr && !state.window_closed &&
                     resolve.top_k != kAllSurfels;
  std::uint64_t rows = 0;
  if (labels_known && plain) {
    rows = vote_tile(job, resolve, list, window, state, scratch.labels.data());
  } else if (labels_known || features_known) {
    select_surfels(resolve, list, window, state, scratch.selected);
    ResolvedPixels out;
    if (labels_known) out.labels = scratch.labels.data();
    if (features_known) {
      out.semantic_feature = scratch.semantic_feature.data();
      out.instance_feature = scratch.instance_feature.data();
    }
    rows =
        scratch.resolver.resolve(resolve, job.projected.shade.data(), scratch.selected, out);
  }
  for_each_pixel(at, [&](std::size_t pixel, int x, int y) {
    const bool surface = is_surface(state, pixel);
    if (labels) {
      write_label(job.frame, surface && labels_known ? scratch.labels[pixel] : PixelLabel{}, x,
                  y);
    }
    if (features) {
      const bool known = surface && features_known;
      job.frame.semantic_feature(x, y) =
          known ? scratch.semantic_feature[pixel] : core::SemanticFeature{};
      job.frame.instance_feature(x, y) =
          known ? scratch.instance_feature[pixel] : core::InstanceFeature{};
    }
  });
  return rows;
}

}  // namespace

void clear_tile(const RasterJob& job, std::size_t tile, int key_count, TileState& state) {
  state.transmittance.fill(1.0F);
  state.depth.fill(0.0F);
  if (has(job.channels, Channels::kRgb)) {
    for (auto* plane : {&state.r, &state.g, &state.b}) plane->fill(0.0F);
  }
  if (has(job.channels, Channels::kNormal)) {
    for (auto* plane : {&state.nx, &state.ny, &state.nz}) plane->fill(0.0F);
  }
  for (int k = 0; k < key_count; ++k) state.keys[k].fill(0);
  state.window_closed = false;
  state.log = job.resolve->top_k == kAllSurfels ? log_pool().take() : nullptr;
  state.live.fill(0.0F);
  for_each_pixel(rectangle_of(job, tile),
                 [&](std::size_t pixel, int, int) { state.live[pixel] = 1.0F; });
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

std::uint64_t write_tile(const RasterJob& job, std::size_t tile,
                         std::span<const std::uint32_t> list, std::uint32_t window,
                         const TileState& state) {
  const TileRectangle at = rectangle_of(job, tile);
  for_each_pixel(
      at, [&](std::size_t pixel, int x, int y) { write_pixel(job, state, pixel, x, y); });
  std::uint64_t rows = 0;
  if (has(job.channels, Channels::kLabels) || has(job.channels, Channels::kFeatures)) {
    rows = write_selected(job, *job.resolve, at, list, window, state);
  }
  if (state.log != nullptr) log_pool().give_back(state.log);
  return rows;
}

}  // namespace segsim::renderer::internal
