#include "renderer/internal/tile_binning.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace segsim::renderer::internal {
namespace {

/// Surfels per task. Fixed, so that the lists do not depend on the number of threads.
constexpr std::size_t kChunkSurfels = 4096;
constexpr unsigned kRadixBits = 11;
constexpr std::size_t kRadix = std::size_t{1} << kRadixBits;
/// Rounding of a row interval [px]; relative to its distance from the image, for long
/// ellipses.
constexpr float kSpanSlackPx = 2e-3F;

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

void TileBins::sort_by_depth(const ProjectedSurfels& projected) {
  keys_.clear();
  order_.clear();
  for (std::size_t v = 0; v < projected.visible_clusters.size(); ++v) {
    for (std::uint32_t i = 0; i < projected.count[v]; ++i) {
      const auto slot = static_cast<std::uint32_t>(v * kClusterSize + i);
      // Positive floats sort like their bits.
      keys_.push_back(std::bit_cast<std::uint32_t>(projected.screen[slot].z0_m));
      order_.push_back(slot);
    }
  }
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

void TileBins::add_span(const Span& span, int tiles_x, Chunk& chunk) {
  if (span.tile_x_begin >= span.tile_x_end) return;
  chunk.spans.push_back(span);
  std::uint32_t* row = chunk.count.data() + static_cast<std::size_t>(span.tile_y) * tiles_x;
  for (int x = span.tile_x_begin; x < span.tile_x_end; ++x) ++row[x];
}

void TileBins::add_surfel(const ProjectedSurfels& projected, std::uint32_t slot,
                          Chunk& chunk) const {
  const ScreenSurfel& s = projected.screen[slot];
  const int x_begin = s.x_lo / kTileSizePx, x_end = s.x_hi / kTileSizePx + 1;
  const int y_begin = s.y_lo / kTileSizePx, y_end = s.y_hi / kTileSizePx + 1;
  const SurfelOutline& outline = projected.outline[slot];
  // One tile wide or high: the box is the answer.
  const bool box_only = x_end - x_begin == 1 || y_end - y_begin == 1 || outline.syy < 0.0F;
  for (int y = y_begin; y < y_end; ++y) {
    int begin = x_begin, end = x_end;
    if (!box_only) {
      const auto y_lo_px = static_cast<float>(y * kTileSizePx) + 0.5F;
      const float radius2 = 0.5F * s.k2 * kBoundSlack;
      const ColumnSpan<float> span =
          columns_in_band(outline, s.x0_px, s.y0_px, radius2, y_lo_px,
                          y_lo_px + static_cast<float>(kTileSizePx - 1));
      const float slack = kSpanSlackPx + 1e-4F * (span.x_max_px - span.x_min_px);
      // Columns whose last pixel centre reaches the span, up to those whose first one does.
      const auto lowest = static_cast<float>(x_begin), highest = static_cast<float>(x_end);
      const float first =
          std::clamp((span.x_min_px - slack - 15.5F) * (1.0F / kTileSizePx), lowest, highest);
      const float last =
          std::clamp((span.x_max_px + slack + 15.5F) * (1.0F / kTileSizePx), lowest, highest);
      begin = static_cast<int>(first);  // Rounded up; std::ceil is a call without SSE 4.1.
      begin += static_cast<float>(begin) < first ? 1 : 0;
      end = static_cast<int>(last);
    }
    add_span({slot, static_cast<std::uint16_t>(y), static_cast<std::uint16_t>(begin),
              static_cast<std::uint16_t>(end)},
             tiles_x_, chunk);
  }
}

void TileBins::find_spans(const ProjectedSurfels& projected, std::size_t index) {
  Chunk& chunk = chunks_[index];
  chunk.spans.clear();
  chunk.count.assign(static_cast<std::size_t>(tiles_x_) * tiles_y_, 0);
  const std::size_t end = std::min(order_.size(), (index + 1) * kChunkSurfels);
  for (std::size_t i = index * kChunkSurfels; i < end; ++i) {
    add_surfel(projected, order_[i], chunk);
  }
}

void TileBins::build(const ProjectedSurfels& projected, int width_px, int height_px,
                     Workers& workers) {
  tiles_x_ = (width_px + kTileSizePx - 1) / kTileSizePx;
  tiles_y_ = (height_px + kTileSizePx - 1) / kTileSizePx;
  sort_by_depth(projected);

  const std::size_t chunk_count = (order_.size() + kChunkSurfels - 1) / kChunkSurfels;
  if (chunks_.size() < chunk_count) chunks_.resize(chunk_count);
  workers.for_each(chunk_count, [&](std::size_t c) { find_spans(projected, c); });

  const std::size_t tile_count = static_cast<std::size_t>(tiles_x_) * tiles_y_;
  first_.resize(tile_count + 1);
  std::uint32_t sum = 0;
  for (std::size_t tile = 0; tile < tile_count; ++tile) {
    first_[tile] = sum;
    for (std::size_t c = 0; c < chunk_count; ++c) {
      const std::uint32_t count = chunks_[c].count[tile];
      chunks_[c].count[tile] = sum;
      sum += count;
    }
  }
  first_[tile_count] = sum;
  slots_.resize(std::max<std::size_t>(slots_.size(), sum));

  workers.for_each(chunk_count, [&](std::size_t c) {
    for (const Span& span : chunks_[c].spans) {
      std::uint32_t* next =
          chunks_[c].count.data() + static_cast<std::size_t>(span.tile_y) * tiles_x_;
      for (int x = span.tile_x_begin; x < span.tile_x_end; ++x) slots_[next[x]++] = span.slot;
    }
  });
}

}  // namespace segsim::renderer::internal
