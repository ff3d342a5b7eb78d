#include "nav/planning/fast_marching.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <queue>

#include "nav/planning/grid_planner.h"

namespace segsim::nav {
namespace {

/// Ties are broken by cell index, so that equal maps give equal fields.
struct Front {
  float arrival;
  std::uint32_t cell;
  bool operator>(const Front& other) const {
    return arrival != other.arrival ? arrival > other.arrival : cell > other.cell;
  }
};

/// Solves max(T - a, 0)^2 + max(T - b, 0)^2 = c^2 for T.
float eikonal(float a, float b, float c) {
  const float low = std::min(a, b), high = std::max(a, b);
  if (high - low >= c) return low + c;
  const float root = std::sqrt(2.0F * c * c - (high - low) * (high - low));
  return 0.5F * (low + high + root);
}

}  // namespace

core::Image<float> fast_marching_m(const CostMap& map, const std::vector<Cell>& goals) {
  const int width = map.frame().width_cells, height = map.frame().height_cells;
  const auto resolution = static_cast<float>(map.frame().resolution_m);
  core::Image<float> arrival(width, height, kUnreachable_m);
  core::Image<std::uint8_t> fixed(width, height, 0);
  std::priority_queue<Front, std::vector<Front>, std::greater<>> front;
  for (const Cell& goal : goals) {
    if (!map.traversable(goal)) continue;
    arrival(goal.x, goal.y) = 0.0F;
    front.push({0.0F, static_cast<std::uint32_t>(goal.y * width + goal.x)});
  }
  const auto at = [&](int x, int y) {
    return arrival.contains(x, y) && fixed(x, y) != 0 ? arrival(x, y) : kUnreachable_m;
  };
  constexpr std::array<std::array<int, 2>, 4> kSides{{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};
  while (!front.empty()) {
    const Front next = front.top();
    front.pop();
    const int x = static_cast<int>(next.cell) % width, y = static_cast<int>(next.cell) / width;
    if (fixed(x, y) != 0) continue;
    fixed(x, y) = 1;
    for (const auto& [dx, dy] : kSides) {
      const int i = x + dx, j = y + dy;
      if (!arrival.contains(i, j) || fixed(i, j) != 0 || !map.traversable({i, j})) continue;
      const float along_x = std::min(at(i - 1, j), at(i + 1, j));
      const float along_y = std::min(at(i, j - 1), at(i, j + 1));
      const float time = eikonal(along_x, along_y, resolution * map.length_costs()(i, j));
      if (time < arrival(i, j)) {
        arrival(i, j) = time;
        front.push({time, static_cast<std::uint32_t>(j * width + i)});
      }
    }
  }
  return arrival;
}

std::optional<Cell> short_term_goal(const CostMap& map, const core::Image<float>& distance_m,
                                    const Cell& from, int reach_cells) {
  if (!distance_m.contains(from.x, from.y)) return std::nullopt;
  std::optional<Cell> best;
  float best_m = distance_m(from.x, from.y);
  for (int dj = -reach_cells; dj <= reach_cells; ++dj) {
    for (int di = -reach_cells; di <= reach_cells; ++di) {
      const Cell cell = from + Cell(di, dj);
      if (di * di + dj * dj > reach_cells * reach_cells ||
          !distance_m.contains(cell.x, cell.y) || !(distance_m(cell.x, cell.y) < best_m)) {
        continue;
      }
      if (map.traversable(from) &&
          !segment_traversable(map, map.frame().center_m(from), map.frame().center_m(cell))) {
        continue;
      }
      best = cell;
      best_m = distance_m(cell.x, cell.y);
    }
  }
  return best;
}

}  // namespace segsim::nav
