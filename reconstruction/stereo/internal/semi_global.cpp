#include "reconstruction/stereo/internal/semi_global.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>

namespace segsim::reconstruction::internal {
namespace {

using Cost = std::int16_t;  ///< Signed: every x86-64 has the minimum of eight of them.

/// Edges of so many grey levels (of 255) halve the penalty of a jump.
constexpr int kEdge = 8 * 256;

/// Path costs of the pixels of one row, for one direction.
struct PathRow {
  PathRow(int width, int planes)
      : stride(planes + 2), cost(static_cast<std::size_t>(width) * stride), lowest(width) {}
  /// Costs of plane 0 ...; those at -1 and `planes` are large.
  Cost* at(int x) { return cost.data() + static_cast<std::size_t>(x) * stride + 1; }
  [[nodiscard]] const Cost* at(int x) const {
    return cost.data() + static_cast<std::size_t>(x) * stride + 1;
  }
  int stride;
  std::vector<Cost> cost;
  std::vector<Cost> lowest;  ///< Of each pixel's costs.
};

constexpr Cost kLarge = 10'000;

class Aggregation {
 public:
  Aggregation(const CostVolume& volume, const core::Image<std::uint16_t>& guide,
              const SmoothnessPenalties& penalties)
      : volume_(volume),
        guide_(guide),
        penalties_(penalties),
        width_(volume.width_px),
        height_(volume.height_px),
        planes_(volume.planes.count),
        sum_(volume.cost.size(), 0) {}

  void run() {
    pass(1);
    pass(-1);
  }
  [[nodiscard]] const Cost* at(int x, int y) const {
    return sum_.data() + (static_cast<std::size_t>(y) * width_ + x) * planes_;
  }

 private:
  /// Four directions: from the pixel before in the row, and from three of the row before.
  void pass(int sign) {
    std::array<PathRow, 3> above{PathRow(width_, planes_), PathRow(width_, planes_),
                                 PathRow(width_, planes_)};
    std::array<PathRow, 3> below = above;
    PathRow along(width_, planes_);
    for (int k = 0; k < height_; ++k) {
      const int y = sign > 0 ? k : height_ - 1 - k;
      for (int i = 0; i < width_; ++i) {
        const int x = sign > 0 ? i : width_ - 1 - i;
        step(x, y, x - sign, y, along, along);
        for (int d = 0; d < 3; ++d) step(x, y, x + d - 1, y - sign, above[d], below[d]);
      }
      std::swap(above, below);
    }
  }

  /// The path that comes to (x, y) from (from_x, from_y).
  void step(int x, int y, int from_x, int from_y, const PathRow& from, PathRow& to) {
    const std::uint8_t* matching = volume_.at(x, y);
    Cost* sum = sum_.data() + (static_cast<std::size_t>(y) * width_ + x) * planes_;
    Cost* path = to.at(x);
    path[-1] = path[planes_] = kLarge;
    Cost lowest = kLarge;
    if (!guide_.contains(from_x, from_y)) {
      for (int p = 0; p < planes_; ++p) {
        path[p] = matching[p];
        sum[p] = static_cast<Cost>(sum[p] + path[p]);
        lowest = std::min(lowest, path[p]);
      }
      to.lowest[x] = lowest;
      return;
    }
    const int edge = std::abs(guide_(x, y) - guide_(from_x, from_y));
    const auto one = static_cast<Cost>(penalties_.one_plane);
    const auto many = static_cast<Cost>(
        std::max(penalties_.fewest_many, penalties_.many_planes * kEdge / (kEdge + edge)));
    const Cost* before = from.at(from_x);
    const Cost base = from.lowest[from_x];
    const auto jump = static_cast<Cost>(base + many);
    for (int p = 0; p < planes_; ++p) {
      const auto beside = static_cast<Cost>(std::min(before[p - 1], before[p + 1]) + one);
      const Cost best = std::min(std::min(before[p], beside), jump);
      const auto cost = static_cast<Cost>(matching[p] + best - base);
      path[p] = cost;
      sum[p] = static_cast<Cost>(sum[p] + cost);
      lowest = std::min(lowest, cost);
    }
    to.lowest[x] = lowest;
  }

  const CostVolume& volume_;
  const core::Image<std::uint16_t>& guide_;
  SmoothnessPenalties penalties_;
  int width_, height_, planes_;
  std::vector<Cost> sum_;  ///< Of all directions; at most 8 (kWorstCost + many_planes).
};

/// Offset of the lowest point of the parabola through three costs, of which b is the smallest.
float parabola(float a, float b, float c) {
  const float curve = a - 2.0F * b + c;
  return curve > 0.0F ? 0.5F * (a - c) / curve : 0.0F;
}

}  // namespace

core::Image<float> semi_global(const CostVolume& volume,
                               const core::Image<std::uint16_t>& guide,
                               const SmoothnessPenalties& penalties) {
  Aggregation aggregation(volume, guide, penalties);
  aggregation.run();
  const int planes = volume.planes.count;
  core::Image<float> inverse_m(volume.width_px, volume.height_px, std::nanf(""));
  for (int y = 0; y < volume.height_px; ++y) {
    for (int x = 0; x < volume.width_px; ++x) {
      const Cost* cost = aggregation.at(x, y);
      const int best = static_cast<int>(std::min_element(cost, cost + planes) - cost);
      Cost rival = std::numeric_limits<Cost>::max();
      for (int p = 0; p < planes; ++p) {
        if (std::abs(p - best) > 2) rival = std::min(rival, cost[p]);
      }
      if (rival <= cost[best]) continue;
      float plane = static_cast<float>(best);
      if (best > 0 && best + 1 < planes) {
        plane += parabola(cost[best - 1], cost[best], cost[best + 1]);
      }
      inverse_m(x, y) = volume.planes.inverse_m(plane);
    }
  }
  return inverse_m;
}

}  // namespace segsim::reconstruction::internal
