#pragma once

/// @file
/// How far rays go before they can meet an obstacle, by direction: most of a view's rays end
/// at the first obstacle in their way, and nothing has to be looked up along the rest of them.

#include <cstdint>
#include <memory>
#include <vector>

#include "core/image.h"

namespace segsim::nav {

/// Of a square window of cells whose middle cell holds the eye. Errs on the near side: by the
/// place of the eye in its cell, and by the width of a bin of directions.
class ObstacleHorizon {
 public:
  /// @param obstacles  1: obstacle. Side by side cells, an odd number.
  void find(const core::Image<std::uint8_t>& obstacles);
  /// No point of a ray from the middle cell that is nearer to its start than so many cells
  /// lies in an obstacle. @param x, y  Its direction, of any length but 0.
  [[nodiscard]] int free_cells(float x, float y) const { return free_cells_[bin_of(x, y)]; }

 private:
  static constexpr int kBins = 512;
  static constexpr int kBinsPerQuarter = kBins / 4;
  /// What an obstacle in one cell of the window hides.
  struct Shadow {
    std::uint16_t first_bin = 0, bins = 0;
    std::uint8_t from_cells = 0;
  };
  /// The direction as a number in [0, 4) that grows with its angle, without trigonometry.
  [[nodiscard]] static float diamond_angle(float x, float y) {
    const float share = y / ((x < 0.0F ? -x : x) + (y < 0.0F ? -y : y));
    return x < 0.0F ? 2.0F - share : y < 0.0F ? 4.0F + share : share;
  }
  [[nodiscard]] static std::size_t bin_of(float x, float y) {
    return static_cast<std::size_t>(diamond_angle(x, y) * kBinsPerQuarter) % kBins;
  }
  [[nodiscard]] static Shadow shadow_of(int dx, int dy);
  /// Made once for each size of a window: to compute them takes as long as a decision.
  [[nodiscard]] static std::shared_ptr<const std::vector<Shadow>> shadows_of_window(int side);

  /// By cell of the window; do not depend on the obstacles.
  std::shared_ptr<const std::vector<Shadow>> shadows_;
  std::vector<std::uint8_t> free_cells_;  ///< By bin.
};

}  // namespace segsim::nav
