#include "reconstruction/stereo/depth_comparison.h"

#include <algorithm>
#include <cmath>

#include "core/quantile.h"
#include "reconstruction/lifting/parallel_loading.h"
#include "renderer/files/exr_io.h"

namespace segsim::reconstruction {
namespace {

constexpr float kNearest_m = 0.2F, kFarthest_m = 6.0F;
constexpr std::size_t kBatch = 16;  ///< Frames in memory at once.

}  // namespace

void DepthComparer::add(const core::Image<float>& estimated_m,
                        const core::Image<float>& measured_m) {
  for (int y = 0; y < estimated_m.height_px(); ++y) {
    const int v = (2 * y + 1) * measured_m.height_px() / (2 * estimated_m.height_px());
    for (int x = 0; x < estimated_m.width_px(); ++x) {
      const int u = (2 * x + 1) * measured_m.width_px() / (2 * estimated_m.width_px());
      const float truth_m = measured_m(u, v);
      if (!(truth_m >= kNearest_m && truth_m <= kFarthest_m)) continue;
      ++measured_;
      const float error_m = std::abs(estimated_m(x, y) - truth_m);
      if (std::isnan(error_m)) continue;
      error_m_.push_back(error_m);
      error_share_.push_back(error_m / truth_m);
    }
  }
}

std::optional<DepthComparison> DepthComparer::result() const {
  if (error_m_.empty()) return std::nullopt;
  const auto at = [](const std::vector<float>& values, double share) {
    return static_cast<double>(core::quantile(values, share, core::Between::kNearest));
  };
  DepthComparison comparison;
  comparison.measured = measured_;
  comparison.estimated = error_m_.size();
  comparison.median_m = at(error_m_, 0.5), comparison.high_m = at(error_m_, 0.9);
  comparison.median_share = at(error_share_, 0.5);
  comparison.high_share = at(error_share_, 0.9);
  const auto near = std::count_if(error_share_.begin(), error_share_.end(),
                                  [](float share) { return share <= 0.05F; });
  comparison.within_5_percent =
      static_cast<double>(near) / static_cast<double>(error_share_.size());
  return comparison;
}

std::optional<DepthComparison> compare_with_recorded(const std::filesystem::path& folder,
                                                     const RgbdSequence& sequence) {
  std::vector<std::size_t> frames;
  for (std::size_t i = 0; i < sequence.frame_count(); ++i) {
    if (std::filesystem::exists(folder / own_depth_name(i))) frames.push_back(i);
  }
  DepthComparer comparer;
  for (std::size_t first = 0; first < frames.size(); first += kBatch) {
    const std::size_t count = std::min(kBatch, frames.size() - first);
    std::vector<core::Image<float>> estimated_m(count), measured_m(count);
    internal::load_each(count, [&](std::size_t k) {
      estimated_m[k] = renderer::read_depth_exr(folder / own_depth_name(frames[first + k]));
      measured_m[k] = sequence.load(frames[first + k]).depth_m;
    });
    for (std::size_t k = 0; k < count; ++k) {
      if (!measured_m[k].empty()) comparer.add(estimated_m[k], measured_m[k]);
    }
  }
  return comparer.result();
}

}  // namespace segsim::reconstruction
