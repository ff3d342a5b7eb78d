#include "nav/objects/segmenter.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace segsim::nav {
namespace {

constexpr float kBin_m = 0.1F;
constexpr std::size_t kBins = 200;  // 20 m; farther depth counts into the last.
constexpr std::size_t kGapBins = 3;
constexpr double kNearShare = 0.25;
constexpr float kCoreShare = 0.65F;  // Of the box's sides: its edges show what stands around.

std::size_t bin_of(float depth_m) {
  return std::min(static_cast<std::size_t>(std::min(depth_m, 1e3F) / kBin_m), kBins - 1);
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
    std::array<std::size_t, kBins> histogram{};
    std::size_t total = 0;
    const auto count = [&](const core::BoxPx& part) {
      for (int y = edge(part.y0, depth_m.height_px()); y < edge(part.y1, depth_m.height_px());
           ++y) {
        for (int x = edge(part.x0, depth_m.width_px()); x < edge(part.x1, depth_m.width_px());
             ++x) {
          const float depth = depth_m(x, y);
          if (!(depth > 0.0F)) continue;
          ++histogram[bin_of(depth)];
          ++total;
        }
      }
    };
    const float dx = 0.5F * (1.0F - kCoreShare) * box.width_px();
    const float dy = 0.5F * (1.0F - kCoreShare) * box.height_px();
    count({box.x0 + dx, box.y0 + dy, box.x1 - dx, box.y1 - dy});
    if (total == 0) count(box);  // Tiny, or all holes in the middle.
    const Layer layer = total > 0 ? choose_layer(histogram, total) : Layer{};
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) {
        const float depth = depth_m(x, y);
        const bool measured = depth > 0.0F;
        const std::size_t bin = measured ? bin_of(depth) : 0;
        const bool inside =
            total == 0 || (measured && bin >= layer.first && bin <= layer.last);
        mask(x, y) = inside ? 1 : 0;
      }
    }
    return mask;
  }
};

}  // namespace

std::unique_ptr<Segmenter> make_depth_segmenter() {
  return std::make_unique<DepthSegmenter>();
}

}  // namespace segsim::nav
