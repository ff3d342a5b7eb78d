#include "renderer/training/depth_completion.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace segsim::renderer {
namespace {

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

/// Half the size; means of the known ones of 2 x 2 pixels.
core::Image<float> pushed(const core::Image<float>& fine) {
  core::Image<float> coarse((fine.width_px() + 1) / 2, (fine.height_px() + 1) / 2);
  for (int y = 0; y < coarse.height_px(); ++y) {
    for (int x = 0; x < coarse.width_px(); ++x) {
      float sum = 0.0F;
      int known = 0;
      for (int v = 2 * y; v < std::min(2 * y + 2, fine.height_px()); ++v) {
        for (int u = 2 * x; u < std::min(2 * x + 2, fine.width_px()); ++u) {
          if (std::isnan(fine(u, v))) continue;
          sum += fine(u, v);
          ++known;
        }
      }
      coarse(x, y) = known > 0 ? sum / static_cast<float>(known) : kUnknown;
    }
  }
  return coarse;
}

/// Unknown pixels take the linear interpolation of the coarser image, which has no gaps.
void pull(const core::Image<float>& coarse, core::Image<float>& fine) {
  const auto neighbours = [](int i, int size) {
    const int near = i / 2, far = i % 2 == 0 ? near - 1 : near + 1;
    return std::pair(near, std::clamp(far, 0, size - 1));
  };
  for (int y = 0; y < fine.height_px(); ++y) {
    for (int x = 0; x < fine.width_px(); ++x) {
      if (!std::isnan(fine(x, y))) continue;
      const auto [x0, x1] = neighbours(x, coarse.width_px());
      const auto [y0, y1] = neighbours(y, coarse.height_px());
      // Centres of coarse pixels are a quarter and three quarters of theirs away.
      fine(x, y) = 0.75F * (0.75F * coarse(x0, y0) + 0.25F * coarse(x1, y0)) +
                   0.25F * (0.75F * coarse(x0, y1) + 0.25F * coarse(x1, y1));
    }
  }
}

}  // namespace

core::Image<float> completed_depth_m(const core::Image<float>& depth_m, double min_m,
                                     double max_m) {
  std::vector<core::Image<float>> levels{depth_m};
  bool any = false;
  for (std::size_t i = 0; i < levels[0].size(); ++i) {
    float& depth = levels[0].data()[i];
    const auto value = static_cast<double>(depth);
    if (!(value > min_m && value < max_m)) depth = kUnknown;
    any = any || !std::isnan(depth);
  }
  if (!any) return std::move(levels[0]);
  while (levels.back().size() > 1) {
    core::Image<float> coarse = pushed(levels.back());
    levels.push_back(std::move(coarse));
  }
  for (std::size_t level = levels.size() - 1; level > 0; --level) {
    pull(levels[level], levels[level - 1]);
  }
  return std::move(levels[0]);
}

}  // namespace segsim::renderer
