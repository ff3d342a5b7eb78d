#include "nav/objects/segmenter.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

namespace segsim::nav {
namespace {

constexpr float kBin_m = 0.1F;
constexpr std::size_t kBins = 200;  // 20 m; farther depth counts into the last.
constexpr std::size_t kGapBins = 3;
constexpr double kNearShare = 0.25;
constexpr float kCoreShare = 0.65F;  // Of the box's sides: its edges show what stands around.

/// Of a positive depth.
std::int32_t bin_of(float depth_m) {
  const auto bin = static_cast<std::int32_t>((depth_m < 1e3F ? depth_m : 1e3F) / kBin_m);
  return bin < static_cast<std::int32_t>(kBins) ? bin : static_cast<std::int32_t>(kBins) - 1;
}

/// The largest depth of a bin [m]: bins ascend with the depth, and depths with their bits.
float last_depth_m(std::size_t bin) {
  std::uint32_t inside = 0,
                beyond =
                    std::bit_cast<std::uint32_t>(std::numeric_limits<float>::infinity()) + 1;
  while (beyond - inside > 1) {
    const std::uint32_t middle = inside + (beyond - inside) / 2;
    const auto at = static_cast<std::size_t>(bin_of(std::bit_cast<float>(middle)));
    (at <= bin ? inside : beyond) = middle;
  }
  return std::bit_cast<float>(inside);
}

/// How many measured pixels fall into each bin.
class Histogram {
 public:
  void add_row(const float* __restrict depths, std::size_t count) {
    bins_.resize(std::max(bins_.size(), count));
    std::int32_t* __restrict bins = bins_.data();
    for (std::size_t x = 0; x < count; ++x) {
      const float depth = depths[x] > 0.0F ? depths[x] : 0.0F;  // NaN too.
      bins[x] = depths[x] > 0.0F ? bin_of(depth) : static_cast<std::int32_t>(kBins);
    }
    // Neighbours mostly fall into one bin: four counters for each, or one waits for the other.
    for (std::size_t x = 0; x < count; ++x) {
      ++counts_[x % 4][static_cast<std::size_t>(bins[x])];
    }
  }
  [[nodiscard]] std::array<std::size_t, kBins> counts() const {
    std::array<std::size_t, kBins> sums{};
    for (const auto& part : counts_) {
      for (std::size_t k = 0; k < kBins; ++k) sums[k] += part[k];
    }
    return sums;
  }

 private:
  std::vector<std::int32_t> bins_;                                // Scratch: of one row.
  std::array<std::array<std::uint32_t, kBins + 1>, 4> counts_{};  // The last is not measured.
};

/// mask[x] = 1 where a pixel's depth lies in a range. No branches, so that it vectorises; NaN
/// compares false.
void mark_between(const float* __restrict depths, float low_m, float high_m, std::size_t count,
                  std::uint8_t* __restrict mask) {
  for (std::size_t x = 0; x < count; ++x) {
    mask[x] = static_cast<std::uint8_t>(static_cast<int>(depths[x] >= low_m) &
                                        static_cast<int>(depths[x] <= high_m));
  }
}

struct Layer {
  std::size_t first = 0, last = 0, count = 0;
};

/// The nearest layer with a good share; else the largest.
Layer choose_layer(const std::array<std::size_t, kBins>& histogram, std::size_t total) {
  std::vector<Layer> layers;
  for (std::size_t k = 0; k < kBins; ++k) {
    if (histogram[k] == 0) continue;
    if (layers.empty() || k - layers.back().last > kGapBins) layers.push_back({k, k, 0});
    layers.back().last = k;
    layers.back().count += histogram[k];
  }
  const auto enough = [&](const Layer& layer) {
    return static_cast<double>(layer.count) >= kNearShare * static_cast<double>(total);
  };
  const auto near = std::find_if(layers.begin(), layers.end(), enough);
  if (near != layers.end()) return *near;
  return *std::max_element(layers.begin(), layers.end(),
                           [](const Layer& a, const Layer& b) { return a.count < b.count; });
}

class DepthSegmenter final : public Segmenter {
 public:
  core::Image<std::uint8_t> segment(const core::Observation& observation,
                                    const core::BoxPx& box) override {
    const core::Image<float>& depth_m = *observation.depth_m;
    core::Image<std::uint8_t> mask(depth_m.width_px(), depth_m.height_px(), 0);
    const auto edge = [](float value, int size) {
      return static_cast<int>(std::clamp(std::round(value), 0.0F, static_cast<float>(size)));
    };
    const int x0 = edge(box.x0, depth_m.width_px()), x1 = edge(box.x1, depth_m.width_px());
    const int y0 = edge(box.y0, depth_m.height_px()), y1 = edge(box.y1, depth_m.height_px());
    const auto counted = [&](const core::BoxPx& part) {
      Histogram histogram;
      const int left = edge(part.x0, depth_m.width_px());
      const int right = std::max(edge(part.x1, depth_m.width_px()), left);
      for (int y = edge(part.y0, depth_m.height_px()); y < edge(part.y1, depth_m.height_px());
           ++y) {
        histogram.add_row(depth_m.row(y) + left, static_cast<std::size_t>(right - left));
      }
      return histogram.counts();
    };
    const auto total_of = [](const std::array<std::size_t, kBins>& histogram) {
      return std::accumulate(histogram.begin(), histogram.end(), std::size_t{0});
    };
    const float dx = 0.5F * (1.0F - kCoreShare) * box.width_px();
    const float dy = 0.5F * (1.0F - kCoreShare) * box.height_px();
    auto histogram = counted({box.x0 + dx, box.y0 + dy, box.x1 - dx, box.y1 - dy});
    // Tiny, or all holes in the middle.
    if (total_of(histogram) == 0) histogram = counted(box);
    const std::size_t total = total_of(histogram);
    const auto width = static_cast<std::size_t>(std::max(x1 - x0, 0));
    if (total == 0) {
      for (int y = y0; y < y1; ++y) std::fill_n(mask.row(y) + x0, width, std::uint8_t{1});
      return mask;
    }
    const Layer layer = choose_layer(histogram, total);
    const float low_m = std::nextafter(layer.first > 0 ? last_depth_m(layer.first - 1) : 0.0F,
                                       std::numeric_limits<float>::infinity());
    const float high_m = last_depth_m(layer.last);
    for (int y = y0; y < y1; ++y) {
      mark_between(depth_m.row(y) + x0, low_m, high_m, width, mask.row(y) + x0);
    }
    return mask;
  }
};

}  // namespace

std::unique_ptr<Segmenter> make_depth_segmenter() {
  return std::make_unique<DepthSegmenter>();
}

}  // namespace segsim::nav
