#include "nav/planning/grid_planner.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numbers>
#include <queue>
#include <utility>

#include "core/check.h"

namespace segsim::nav {
namespace {

struct Step {
  int dx, dy;
  float length;  ///< In cells.
};
constexpr std::array<Step, 8> kSteps{{{1, 0, 1.0F},
                                      {-1, 0, 1.0F},
                                      {0, 1, 1.0F},
                                      {0, -1, 1.0F},
                                      {1, 1, std::numbers::sqrt2_v<float>},
                                      {1, -1, std::numbers::sqrt2_v<float>},
                                      {-1, 1, std::numbers::sqrt2_v<float>},
                                      {-1, -1, std::numbers::sqrt2_v<float>}}};

/// Queue entry; ties are broken by cell index, so that equal maps give equal paths.
struct Open {
  float priority;
  std::uint32_t cell;
  bool operator>(const Open& other) const {
    return priority != other.priority ? priority > other.priority : cell > other.cell;
  }
};
using OpenQueue = std::priority_queue<Open, std::vector<Open>, std::greater<>>;

/// The same in one number each, so that one comparison orders two: the bits of a priority,
/// which ascend with it from 0 on, above the cell's row and column.
class PackedQueue {
 public:
  /// @param heap  Memory, from an earlier queue or empty.
  explicit PackedQueue(std::vector<std::uint64_t>& heap) : heap_(heap) { heap_.clear(); }
  [[nodiscard]] bool empty() const { return heap_.empty(); }
  void push(float priority, const Cell& cell) {
    const auto place =
        static_cast<std::uint32_t>(cell.y) << 16 | static_cast<std::uint32_t>(cell.x);
    const std::uint64_t entry =
        static_cast<std::uint64_t>(std::bit_cast<std::uint32_t>(priority)) << 32 | place;
    // Four children to a parent: half as many levels, and all four in one cache line.
    std::size_t at = heap_.size();
    heap_.push_back(entry);
    while (at > 0) {
      const std::size_t parent = (at - 1) / 4;
      if (heap_[parent] <= entry) break;
      heap_[at] = heap_[parent];
      at = parent;
    }
    heap_[at] = entry;
  }
  std::pair<float, Cell> pop() {
    const std::uint64_t top = heap_.front();
    const std::uint64_t last = heap_.back();
    heap_.pop_back();
    const std::size_t size = heap_.size();
    std::size_t at = 0;
    while (4 * at + 1 < size) {
      const std::size_t first = 4 * at + 1, end = std::min(first + 4, size);
      std::size_t least = first;
      for (std::size_t k = first + 1; k < end; ++k) {
        if (heap_[k] < heap_[least]) least = k;
      }
      if (heap_[least] >= last) break;
      heap_[at] = heap_[least];
      at = least;
    }
    if (size > 0) heap_[at] = last;
    return {std::bit_cast<float>(static_cast<std::uint32_t>(top >> 32)),
            Cell(static_cast<int>(top & 0xFFFF), static_cast<int>(top >> 16 & 0xFFFF))};
  }

 private:
  std::vector<std::uint64_t>& heap_;
};

/// Mean weighted length of the segment, or nullopt if it leaves the traversable cells.
std::optional<double> segment_cost_m(const CostMap& map, const glm::dvec2& a_m,
                                     const glm::dvec2& b_m) {
  const double length_m = glm::length(b_m - a_m);
  const int samples =
      std::max(1, static_cast<int>(std::ceil(length_m / (0.5 * map.frame().resolution_m))));
  double sum = 0.0;
  for (int k = 0; k <= samples; ++k) {
    const double t = static_cast<double>(k) / samples;
    const Cell cell = map.frame().cell_at(a_m + t * (b_m - a_m));
    if (!map.traversable(cell)) return std::nullopt;
    sum += static_cast<double>(map.length_cost(cell));
  }
  return length_m * sum / (samples + 1);
}

/// Replaces stretches of the chain by segments that are free and not dearer than the stretch.
std::vector<glm::dvec2> shortened(const CostMap& map, const std::vector<Cell>& cells) {
  constexpr double kSlack = 1.02;  // Sampling error of the segment's cost.
  std::vector<double> cost_to(cells.size(), 0.0);
  for (std::size_t k = 1; k < cells.size(); ++k) {
    cost_to[k] = cost_to[k - 1] + chain_cost_m(map, {cells[k - 1], cells[k]});
  }
  std::vector<glm::dvec2> points{map.frame().center_m(cells.front())};
  std::size_t at = 0;
  while (at + 1 < cells.size()) {
    // Grow the stretch while it stays allowed; a jump ahead would be missed, which only costs
    // smoothness.
    std::size_t best = at + 1;
    for (std::size_t k = at + 2; k < cells.size(); ++k) {
      const auto cost = segment_cost_m(map, points.back(), map.frame().center_m(cells[k]));
      if (!cost || *cost > kSlack * (cost_to[k] - cost_to[at])) {
        if (k > best + 8) break;
        continue;
      }
      best = k;
    }
    points.push_back(map.frame().center_m(cells[best]));
    at = best;
  }
  return points;
}

}  // namespace

double chain_cost_m(const CostMap& map, const std::vector<Cell>& cells) {
  double sum = 0.0;
  for (std::size_t k = 1; k < cells.size(); ++k) {
    const glm::dvec2 offset(cells[k] - cells[k - 1]);
    sum += glm::length(offset) * map.frame().resolution_m * 0.5 *
           static_cast<double>(map.length_cost(cells[k - 1]) + map.length_cost(cells[k]));
  }
  return sum;
}

bool segment_traversable(const CostMap& map, const glm::dvec2& a_m, const glm::dvec2& b_m) {
  return segment_cost_m(map, a_m, b_m).has_value();
}

std::optional<Cell> nearest_traversable(const CostMap& map, const Cell& from, double limit_m) {
  if (map.traversable(from)) return from;
  if (!map.active().contains(from)) return std::nullopt;
  const auto resolution = static_cast<float>(map.frame().resolution_m);
  // No way of this length leads out of the window.
  const int reach = static_cast<int>(limit_m / map.frame().resolution_m) + 1;
  const CellBox window = CellBox{from - reach, from + reach}.clipped_to(map.active());
  const int width = window.width();
  core::Image<float> distance(width, window.height(), kUnreachable_m);
  const auto at_cell = [&](std::uint32_t index) {
    return window.low + Cell(static_cast<int>(index) % width, static_cast<int>(index) / width);
  };
  // Ties go to the lower index, which orders cells as the index in the map does.
  const auto index_in = [&](const Cell& cell) {
    return static_cast<std::uint32_t>((cell.y - window.low.y) * width + cell.x - window.low.x);
  };
  OpenQueue open;
  distance.data()[index_in(from)] = 0.0F;
  open.push({0.0F, index_in(from)});
  while (!open.empty()) {
    const Open top = open.top();
    open.pop();
    const Cell at = at_cell(top.cell);
    if (top.priority > distance.data()[top.cell]) continue;
    if (map.traversable(at)) return at;
    for (const Step& step : kSteps) {
      const Cell next(at.x + step.dx, at.y + step.dy);
      // Obstacles cannot be crossed; what is unknown can, at twice the price.
      if (!window.contains(next) || map.state(next) == CellState::kOccupied) continue;
      const float price = map.state(next) == CellState::kFree ? 1.0F : 2.0F;
      const float there = top.priority + price * step.length * resolution;
      float& known = distance.data()[index_in(next)];
      if (there > static_cast<float>(limit_m) || there >= known) continue;
      known = there;
      open.push({there, index_in(next)});
    }
  }
  return std::nullopt;
}

std::optional<std::vector<Cell>> astar_cells(const CostMap& map, const Cell& start,
                                             const Cell& goal, PlannerMemory* memory) {
  PlannerMemory own;
  PlannerMemory& scratch = memory != nullptr ? *memory : own;
  if (!map.traversable(start) || !map.traversable(goal)) return std::nullopt;
  SEGSIM_CHECK(std::max(map.frame().width_cells, map.frame().height_cells) <= 0x10000,
               "cells of a path that 16 bits count");
  const GridLayer<float>& length_costs = map.length_costs();
  scratch.cost.cover_like(length_costs);
  scratch.parent.cover_like(length_costs);
  const auto index_of = [&](const Cell& cell) {
    return static_cast<std::uint32_t>(length_costs.index_of(cell));
  };
  const std::ptrdiff_t stride = length_costs.stride();
  const auto resolution = static_cast<float>(map.frame().resolution_m);
  // Octile distance; admissible because length_cost is at least 1. Shrunk by rounding's share.
  const auto heuristic = [&](const Cell& cell) {
    const auto dx = static_cast<float>(std::abs(cell.x - goal.x));
    const auto dy = static_cast<float>(std::abs(cell.y - goal.y));
    return 0.9999F * resolution *
           (std::max(dx, dy) + (std::numbers::sqrt2_v<float> - 1.0F) * std::min(dx, dy));
  };
  struct Neighbour {
    std::ptrdiff_t offset;
    Step step;
    float half_m;
  };
  std::array<Neighbour, kSteps.size()> neighbours;
  for (std::size_t n = 0; n < kSteps.size(); ++n) {
    neighbours[n] = {kSteps[n].dy * stride + kSteps[n].dx, kSteps[n],
                     resolution * kSteps[n].length * 0.5F};
  }
  float* cost = scratch.cost.plane();
  std::uint32_t* parent = scratch.parent.plane();
  const std::uint32_t start_index = index_of(start), goal_index = index_of(goal);
  PackedQueue open(scratch.open);
  open.push(heuristic(start), start);
  while (!open.empty()) {
    const auto [priority, at] = open.pop();
    const std::uint32_t index = index_of(at);
    if (index == goal_index) break;
    const float here = cost[index];
    if (priority > here + heuristic(at) + 1e-4F) continue;
    const float* costs = length_costs.plane() + index;
    const std::uint8_t* traversable = map.traversable_cells().plane() + index;
    for (const Neighbour& neighbour : neighbours) {
      const std::ptrdiff_t offset = neighbour.offset;
      const auto next = static_cast<std::uint32_t>(index + offset);
      if (traversable[offset] == 0 || next == start_index) continue;
      const float known = cost[next];
      // Most neighbours lie behind the front: no way leads back to them.
      if (known != 0.0F && known <= here) continue;
      const float there = here + neighbour.half_m * (costs[0] + costs[offset]);
      if (known == 0.0F) {
        scratch.touched.push_back(next);
      } else if (there >= known) {
        continue;
      }
      cost[next] = there;
      parent[next] = index;
      const Cell to = at + Cell(neighbour.step.dx, neighbour.step.dy);
      open.push(there + heuristic(to), to);
    }
  }
  std::optional<std::vector<Cell>> cells;
  if (goal_index == start_index || cost[goal_index] != 0.0F) {
    cells.emplace();
    for (std::uint32_t cell = goal_index; cell != start_index; cell = parent[cell]) {
      cells->push_back(length_costs.cell_of(cell));
    }
    cells->push_back(start);
    std::reverse(cells->begin(), cells->end());
  }
  for (const std::uint32_t cell : scratch.touched) cost[cell] = 0.0F;
  scratch.touched.clear();
  return cells;
}

std::optional<Path> plan_path(const CostMap& map, const glm::dvec2& start_odom_m,
                              const glm::dvec2& goal_odom_m, PlannerMemory* memory) {
  const auto start = nearest_traversable(map, map.frame().cell_at(start_odom_m));
  if (!start) return std::nullopt;
  const auto cells = astar_cells(map, *start, map.frame().cell_at(goal_odom_m), memory);
  if (!cells) return std::nullopt;
  Path path;
  path.cost_m = chain_cost_m(map, *cells);
  path.points_m = shortened(map, *cells);
  path.points_m.back() = goal_odom_m;
  // The first cell's centre may lie behind the robot; replace it unless it is the way out.
  if (map.traversable(map.frame().cell_at(start_odom_m))) {
    path.points_m.front() = start_odom_m;
  } else {
    path.points_m.insert(path.points_m.begin(), start_odom_m);
  }
  if (path.points_m.size() == 1) path.points_m.push_back(goal_odom_m);
  for (std::size_t k = 1; k < path.points_m.size(); ++k) {
    path.length_m += glm::length(path.points_m[k] - path.points_m[k - 1]);
  }
  return path;
}

}  // namespace segsim::nav
