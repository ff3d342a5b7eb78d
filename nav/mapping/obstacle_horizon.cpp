#include "nav/mapping/obstacle_horizon.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <mutex>
#include <utility>

#include "core/check.h"
#include "nav/mapping/internal/set_bytes.h"

namespace segsim::nav {

/// An obstacle so many cells off the middle one. Seen from anywhere in the middle cell it lies
/// in the square of two cells' side around its own centre.
ObstacleHorizon::Shadow ObstacleHorizon::shadow_of(int dx, int dy) {
  const auto x = static_cast<float>(dx), y = static_cast<float>(dy);
  if (std::abs(dx) <= 1 && std::abs(dy) <= 1) return {0, kBins, 0};
  // The eye is outside of the square, which thus covers less than half of all directions.
  const float middle = diamond_angle(x, y);
  float low = 0.0F, high = 0.0F;
  for (const auto& [cx, cy] :
       {std::array{x - 1.0F, y - 1.0F}, std::array{x + 1.0F, y - 1.0F},
        std::array{x - 1.0F, y + 1.0F}, std::array{x + 1.0F, y + 1.0F}}) {
    float off = diamond_angle(cx, cy) - middle;
    if (off > 2.0F) off -= 4.0F;
    if (off < -2.0F) off += 4.0F;
    low = std::min(low, off);
    high = std::max(high, off);
  }
  // One bin more on each side, and one cell less, for rounding.
  constexpr float kPerBin = kBinsPerQuarter;
  const int first = static_cast<int>(std::floor((middle + low) * kPerBin)) - 1;
  const int last = static_cast<int>(std::floor((middle + high) * kPerBin)) + 1;
  const float away =
      std::hypot(std::max(std::abs(x) - 1.0F, 0.0F), std::max(std::abs(y) - 1.0F, 0.0F));
  return {static_cast<std::uint16_t>((first + kBins) % kBins),
          static_cast<std::uint16_t>(std::min(last - first + 1, kBins)),
          static_cast<std::uint8_t>(std::clamp(away - 1.0F, 0.0F, 255.0F))};
}

std::shared_ptr<const std::vector<ObstacleHorizon::Shadow>> ObstacleHorizon::shadows_of_window(
    int side) {
  SEGSIM_CHECK(side % 2 == 1, "a window with a middle cell");
  static std::mutex mutex;
  static std::map<int, std::shared_ptr<const std::vector<Shadow>>> made;
  const std::lock_guard lock(mutex);
  auto& shadows = made[side];
  if (shadows == nullptr) {
    std::vector<Shadow> table;
    table.reserve(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
    for (int j = 0; j < side; ++j) {
      for (int i = 0; i < side; ++i) table.push_back(shadow_of(i - side / 2, j - side / 2));
    }
    shadows = std::make_shared<const std::vector<Shadow>>(std::move(table));
  }
  return shadows;
}

void ObstacleHorizon::find(const core::Image<std::uint8_t>& obstacles) {
  SEGSIM_CHECK(obstacles.width_px() == obstacles.height_px(), "a square window");
  if (shadows_ == nullptr || shadows_->size() != obstacles.size()) {
    shadows_ = shadows_of_window(obstacles.width_px());
  }
  free_cells_.assign(kBins, 255);
  internal::for_each_set(obstacles.data(), obstacles.size(), 1, [&](std::size_t cell) {
    const Shadow& shadow = (*shadows_)[cell];
    std::size_t bin = shadow.first_bin;
    for (int k = 0; k < shadow.bins; ++k) {
      free_cells_[bin] = std::min(free_cells_[bin], shadow.from_cells);
      bin = (bin + 1) % kBins;
    }
  });
}

}  // namespace segsim::nav
