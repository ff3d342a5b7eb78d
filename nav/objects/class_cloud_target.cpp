/// Which point of a cloud to go to, and the groups that its points form.

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "nav/objects/class_cloud.h"

namespace segsim::nav {
namespace {

constexpr float kSquare_m = 0.25F;  // The surroundings of a target are three of these wide.

using Square = std::pair<int, int>;

Square square_of(const CloudPoint& point) {
  return {static_cast<int>(std::floor(point.p_odom_m.x / kSquare_m)),
          static_cast<int>(std::floor(point.p_odom_m.y / kSquare_m))};
}

/// How many points lie in each square of the rectangle that holds them all, with a border of
/// empty ones.
class SquareCounts {
 public:
  SquareCounts(const std::vector<CloudPoint>& cloud,
               const std::vector<std::uint32_t>& points) {
    Square low = square_of(cloud[points.front()]), high = low;
    squares_.reserve(points.size());
    for (const std::uint32_t k : points) {
      const Square square = square_of(cloud[k]);
      low = {std::min(low.first, square.first), std::min(low.second, square.second)};
      high = {std::max(high.first, square.first), std::max(high.second, square.second)};
      squares_.push_back(square);
    }
    constexpr std::size_t kMost = std::size_t{1} << 26;
    const auto rows = static_cast<std::size_t>(high.first - low.first) + 3;
    columns_ = static_cast<std::size_t>(high.second - low.second) + 3;
    SEGSIM_CHECK(rows < kMost && columns_ < kMost && rows * columns_ < kMost,
                 "points too far apart for squares of 0.25 m");
    low_ = {low.first - 1, low.second - 1};
    counts_.assign(rows * columns_, 0);
    for (const Square& square : squares_) ++counts_[index_of(square)];
  }
  /// In the square of each point and in the eight around it.
  [[nodiscard]] std::vector<int> around() const {
    std::vector<int> sums(counts_.size(), 0);
    for (std::size_t k = columns_ + 1; k + columns_ + 1 < counts_.size(); ++k) {
      if (counts_[k] == 0) continue;
      for (const std::size_t row : {k - columns_, k, k + columns_}) {
        sums[k] += counts_[row - 1] + counts_[row] + counts_[row + 1];
      }
    }
    std::vector<int> of_points;
    of_points.reserve(squares_.size());
    for (const Square& square : squares_) of_points.push_back(sums[index_of(square)]);
    return of_points;
  }

 private:
  [[nodiscard]] std::size_t index_of(const Square& square) const {
    return static_cast<std::size_t>(square.first - low_.first) * columns_ +
           static_cast<std::size_t>(square.second - low_.second);
  }

  std::vector<Square> squares_;  // Of each point.
  Square low_;
  std::size_t columns_ = 0;
  std::vector<int> counts_;
};

/// Of each square, the number of its group; squares that touch, also by a corner, share one.
std::map<Square, std::size_t> grouped(const std::vector<CloudPoint>& points,
                                      std::size_t& groups) {
  constexpr auto kNone = static_cast<std::size_t>(-1);
  std::map<Square, std::size_t> group_of;
  for (const CloudPoint& point : points) group_of.try_emplace(square_of(point), kNone);
  groups = 0;
  for (auto& [first, group] : group_of) {
    if (group != kNone) continue;
    group = groups++;
    std::vector<Square> border{first};
    while (!border.empty()) {
      const Square at = border.back();
      border.pop_back();
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          const auto next = group_of.find({at.first + dx, at.second + dy});
          if (next == group_of.end() || next->second != kNone) continue;
          next->second = group;
          border.push_back(next->first);
        }
      }
    }
  }
  return group_of;
}

}  // namespace

std::vector<CloudGroup> ClassCloud::groups() const {
  std::size_t count = 0;
  const std::map<Square, std::size_t> group_of = grouped(points_, count);
  std::vector<CloudGroup> groups(count);
  std::vector<std::size_t> sizes(count, 0);
  std::vector<std::set<std::uint32_t>> sources(count);
  for (const CloudPoint& point : points_) {
    const std::size_t k = group_of.at(square_of(point));
    groups[k].center_m += glm::dvec2(point.p_odom_m);
    ++sizes[k];
    sources[k].insert(point.source);
  }
  for (std::size_t k = 0; k < count; ++k) {
    groups[k].center_m /= static_cast<double>(sizes[k]);
    for (const std::uint32_t source : sources[k]) {
      groups[k].made_of.push_back(sources_[source]);
    }
  }
  return groups;
}

/// The points that may be targets: trusted ones if there are any, and of these the ones that
/// ClassCloudOptions::support_share allows.
void ClassCloud::find_candidates() {
  candidates_.clear();
  const bool trusted_only =
      std::any_of(points_.begin(), points_.end(),
                  [](const CloudPoint& p) { return p.detection == kTrusted; });
  for (std::size_t k = 0; k < points_.size(); ++k) {
    if (!trusted_only || points_[k].detection == kTrusted) {
      candidates_.push_back(static_cast<std::uint32_t>(k));
    }
  }
  if (options_.support_share <= 0.0) return;
  const std::vector<int> around = SquareCounts(points_, candidates_).around();
  const double least =
      options_.support_share * *std::max_element(around.begin(), around.end());
  std::size_t kept = 0;
  for (std::size_t k = 0; k < candidates_.size(); ++k) {
    if (!(around[k] < least)) candidates_[kept++] = candidates_[k];
  }
  candidates_.resize(kept);
}

std::optional<glm::dvec3> ClassCloud::target_m(const glm::dvec2& robot_m) {
  if (points_.empty()) {
    last_target_m_.reset();
    return std::nullopt;
  }
  if (std::exchange(changed_, false)) find_candidates();
  const CloudPoint* best = nullptr;
  double best_m = 1e18, best_m2 = 1e36;
  for (const std::uint32_t k : candidates_) {
    // A root is taken only where it may be the smaller one.
    const glm::dvec2 offset_m = robot_m - glm::dvec2(points_[k].p_odom_m);
    const double distance_m2 = glm::dot(offset_m, offset_m);
    if (distance_m2 >= best_m2) continue;
    const double distance_m = std::sqrt(distance_m2);
    if (distance_m < best_m) {
      best_m = distance_m;
      best_m2 = distance_m2;
      best = &points_[k];
    }
  }
  const glm::dvec3 now(best->p_odom_m);
  if (last_target_m_) {
    const double moved_m = glm::distance(glm::dvec2(now), glm::dvec2(*last_target_m_));
    if (moved_m < options_.keep_below_m ||
        (moved_m < options_.keep_far_below_m && best_m > options_.far_m)) {
      return last_target_m_;
    }
  }
  last_target_m_ = now;
  return last_target_m_;
}

}  // namespace segsim::nav
