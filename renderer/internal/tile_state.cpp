#include "renderer/internal/tile_state.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

namespace segsim::renderer::internal {
namespace {

struct TileRectangle {
  int x, y;           ///< First pixel in the image.
  int width, height;  ///< Pixels of the tile inside the image.
};

TileRectangle rectangle_of(const RasterJob& job, std::size_t tile) {
  const auto index = static_cast<int>(tile);
  const int x = index % job.bins.tiles_x() * kTileSizePx;
  const int y = index / job.bins.tiles_x() * kTileSizePx;
  return {x, y, std::min(kTileSizePx, job.frame.intrinsics.width_px - x),
          std::min(kTileSizePx, job.frame.intrinsics.height_px - y)};
}

/// Heaviest surfels of a pixel over all windows, heaviest first.
/// @return  How many there are, <= job.top_k.
int heaviest_surfels(const RasterJob& job, std::span<const std::uint32_t> list,
                     std::uint32_t window, const TileState& state, std::size_t pixel,
                     std::array<WeightedLabel, 2 * kMaxTopK>& found) {
  int count = 0;
  for (int k = 0; k < job.top_k; ++k) {
    const std::uint32_t key = state.keys[k][pixel];
    const float weight = std::bit_cast<float>(key & ~kKeyPositionMask);
    if (weight <= 0.0F) break;
    const std::uint32_t slot = list[window + (key & kKeyPositionMask)];
    found[count++] = {weight, job.projected.shade[slot].label};
  }
  if (window == 0) return count;
  for (int k = 0; k < state.earlier_count[pixel]; ++k) {
    found[count++] = state.earlier[pixel][k];
  }
  std::stable_sort(
      found.begin(), found.begin() + count,
      [](const WeightedLabel& a, const WeightedLabel& b) { return a.weight > b.weight; });
  return std::min(count, job.top_k);
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
  if (core::has(job.channels, core::Channels::kRgb)) {
    frame.rgb(x, y) = {to_byte(state.r[pixel]), to_byte(state.g[pixel]),
                       to_byte(state.b[pixel])};
  }
  if (core::has(job.channels, core::Channels::kDepth)) {
    const float depth_m = job.median_depth ? state.depth[pixel] : state.depth[pixel] / alpha;
    frame.depth_m(x, y) = surface ? depth_m : std::numeric_limits<float>::quiet_NaN();
  }
  if (core::has(job.channels, core::Channels::kNormal)) {
    const glm::vec3 sum(state.nx[pixel], state.ny[pixel], state.nz[pixel]);
    const float length = std::sqrt(sum.x * sum.x + sum.y * sum.y + sum.z * sum.z);
    frame.normal(x, y) = surface && length > 0.0F ? sum / length : glm::vec3(0.0F);
  }
}

void write_labels(const RasterJob& job, const TileRectangle& at,
                  std::span<const std::uint32_t> list, std::uint32_t window,
                  const TileState& state) {
  std::array<WeightedLabel, 2 * kMaxTopK> found{};
  for (int row = 0; row < at.height; ++row) {
    for (int column = 0; column < at.width; ++column) {
      const auto pixel = static_cast<std::size_t>(row * kTileSizePx + column);
      PixelLabel label;
      if (job.labelled && 1.0F - state.transmittance[pixel] >= kMinSurfaceAlpha) {
        label = vote(found.data(), heaviest_surfels(job, list, window, state, pixel, found));
      }
      job.frame.semantic(at.x + column, at.y + row) = label.semantic;
      job.frame.instance(at.x + column, at.y + row) = label.instance;
      job.frame.confidence(at.x + column, at.y + row) = label.confidence;
    }
  }
}

}  // namespace

void clear_tile(const RasterJob& job, std::size_t tile, int key_count, TileState& state) {
  state.transmittance.fill(1.0F);
  state.depth.fill(0.0F);
  if (core::has(job.channels, core::Channels::kRgb)) {
    for (auto* plane : {&state.r, &state.g, &state.b}) plane->fill(0.0F);
  }
  if (core::has(job.channels, core::Channels::kNormal)) {
    for (auto* plane : {&state.nx, &state.ny, &state.nz}) plane->fill(0.0F);
  }
  for (int k = 0; k < key_count; ++k) state.keys[k].fill(0);
  const TileRectangle at = rectangle_of(job, tile);
  state.live.fill(0.0F);
  for (int row = 0; row < at.height; ++row) {
    std::fill_n(state.live.data() + static_cast<std::size_t>(row) * kTileSizePx, at.width,
                1.0F);
  }
}

void close_window(const RasterJob& job, std::span<const std::uint32_t> list,
                  std::uint32_t window, TileState& state) {
  if (window == 0) state.earlier_count.fill(0);
  std::array<WeightedLabel, 2 * kMaxTopK> found{};
  for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
    const int count = heaviest_surfels(job, list, window, state, pixel, found);
    std::copy_n(found.begin(), count, state.earlier[pixel].begin());
    state.earlier_count[pixel] = count;
  }
  for (auto& keys : state.keys) keys.fill(0);
}

void write_tile(const RasterJob& job, std::size_t tile, std::span<const std::uint32_t> list,
                std::uint32_t window, const TileState& state) {
  const TileRectangle at = rectangle_of(job, tile);
  for (int row = 0; row < at.height; ++row) {
    for (int column = 0; column < at.width; ++column) {
      write_pixel(job, state, static_cast<std::size_t>(row * kTileSizePx + column),
                  at.x + column, at.y + row);
    }
  }
  if (core::has(job.channels, core::Channels::kLabels)) {
    write_labels(job, at, list, window, state);
  }
}

}  // namespace segsim::renderer::internal
