#include "sim/ground/distance_field.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <queue>
#include <tuple>

#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::sim {
namespace {

constexpr float kFar = std::numeric_limits<float>::infinity();

/// A direction of the lattice and the cells that the segment between two centres passes
/// through.
struct Step {
  int di = 0, dj = 0;
  float length_cells = 0.0F;
  std::array<glm::ivec2, 6> crossed{};
  int crossed_count = 0;
};

/// Cells other than the first whose interior the segment from centre (0, 0) to centre (di, dj)
/// meets; where it passes exactly through a corner, both side cells count, so that it cannot
/// slip between two obstacles.
void find_crossed(Step& step) {
  const int i1 = std::max(step.di, 0);
  const int j1 = std::max(step.dj, 0);
  for (int j = std::min(step.dj, 0); j <= j1; ++j) {
    for (int i = std::min(step.di, 0); i <= i1; ++i) {
      if (i == 0 && j == 0) continue;
      // The segment meets the closed square if its line does, within the bounding box just
      // scanned.
      const double off = std::abs(static_cast<double>(step.dj * i - step.di * j));
      const double reach = 0.5 * (std::abs(step.di) + std::abs(step.dj));
      if (off <= reach) step.crossed[static_cast<std::size_t>(step.crossed_count++)] = {i, j};
    }
  }
}

std::array<Step, 32> make_steps() {
  std::array<Step, 32> steps;
  std::size_t count = 0;
  constexpr std::array<std::array<int, 2>, 5> kFirstOctant = {
      {{1, 0}, {1, 1}, {2, 1}, {3, 1}, {3, 2}}};
  for (const auto& [a, b] : kFirstOctant) {
    for (int mirror = 0; mirror < 8; ++mirror) {
      int di = (mirror & 1) != 0 ? -a : a;
      int dj = (mirror & 2) != 0 ? -b : b;
      if ((mirror & 4) != 0) std::swap(di, dj);
      const bool known =
          std::any_of(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(count),
                      [&](const Step& s) { return s.di == di && s.dj == dj; });
      if (known) continue;
      Step& step = steps[count++];
      step.di = di;
      step.dj = dj;
      step.length_cells = static_cast<float>(std::hypot(di, dj));
      find_crossed(step);
    }
  }
  SEGSIM_CHECK(count == steps.size(), "lattice directions");
  return steps;
}

bool step_is_free(const GridMask& free, int i, int j, const Step& step) {
  for (int k = 0; k < step.crossed_count; ++k) {
    const glm::ivec2 c = step.crossed[static_cast<std::size_t>(k)];
    if (!free.contains(i + c.x, j + c.y) || free(i + c.x, j + c.y) == 0) return false;
  }
  return true;
}

/// Whether the straight line between two points stays in free cells (sampled at a fifth of a
/// cell).
bool sees(const FreeSpace& space, const glm::dvec2& a, const glm::dvec2& b) {
  const double length_m = glm::distance(a, b);
  const int count = static_cast<int>(std::ceil(length_m / (0.2 * space.frame.cell_m)));
  for (int k = 0; k <= count; ++k) {
    if (!space.is_free(a + (b - a) * (count > 0 ? double(k) / count : 0.0))) return false;
  }
  return true;
}

}  // namespace

bool FreeSpace::is_free(const glm::dvec2& p_m) const {
  const glm::ivec2 cell = frame.cell_of(p_m);
  return frame.contains(cell) && free(cell.x, cell.y) != 0;
}

int FreeSpace::island_at(const glm::dvec2& p_m) const {
  const glm::ivec2 cell = frame.cell_of(p_m);
  return frame.contains(cell) ? island(cell.x, cell.y) : 0;
}

glm::ivec2 FreeSpace::nearest_free(const glm::dvec2& p_m, double reach_m,
                                   int only_island) const {
  const glm::ivec2 cell = frame.cell_of(p_m);
  const int span = static_cast<int>(std::ceil(reach_m / frame.cell_m)) + 1;
  glm::ivec2 best(-1, -1);
  double best_m = reach_m;
  for (int j = std::max(0, cell.y - span); j <= std::min(frame.height - 1, cell.y + span);
       ++j) {
    for (int i = std::max(0, cell.x - span); i <= std::min(frame.width - 1, cell.x + span);
         ++i) {
      if (free(i, j) == 0 || (only_island > 0 && island(i, j) != only_island)) continue;
      const double d = glm::distance(frame.center_m(i, j), p_m);
      if (d < best_m || (d <= best_m && best.x < 0)) {
        best_m = d;
        best = {i, j};
      }
    }
  }
  return best;
}

double FreeSpace::area_m2(int of_island) const {
  std::size_t cells = 0;
  for (const std::int32_t id : island.pixels()) {
    if (id > 0 && (of_island == 0 || id == of_island)) ++cells;
  }
  return static_cast<double>(cells) * frame.cell_m * frame.cell_m;
}

FreeSpace make_free_space(const CollisionWorld& obstacles, double margin_m) {
  FreeSpace space;
  const GridFrame& fine = obstacles.frame();
  space.radius_m = obstacles.robot().circumscribed_radius_m() + margin_m;
  const double ratio = fine.cell_m / FreeSpace::kCell_m;
  const glm::dvec2 first = glm::floor(fine.origin_m / FreeSpace::kCell_m);
  space.frame = {.origin_m = first * FreeSpace::kCell_m,
                 .cell_m = FreeSpace::kCell_m,
                 .width = static_cast<int>(std::ceil(fine.width * ratio)) + 1,
                 .height = static_cast<int>(std::ceil(fine.height * ratio)) + 1};
  space.free = GridMask(space.frame.width, space.frame.height, 0);
  for (int j = 0; j < space.frame.height; ++j) {
    for (int i = 0; i < space.frame.width; ++i) {
      const glm::dvec2 p = space.frame.center_m(i, j);
      const bool fits =
          obstacles.body_distance_m(p) >= space.radius_m &&
          (obstacles.robot().mast_height_m <= obstacles.robot().body_top_m ||
           obstacles.mast_distance_m(p) >= obstacles.robot().mast_radius_m + margin_m);
      space.free(i, j) = fits ? 1 : 0;
    }
  }
  space.island = label_pieces(space.free);
  return space;
}

DistanceField::DistanceField(const FreeSpace& space, std::span<const glm::dvec2> goals_m,
                             double goal_snap_m)
    : space_(&space),
      distance_m_(space.frame.width, space.frame.height, kFar),
      next_(space.frame.width, space.frame.height, -1),
      goal_(space.frame.width, space.frame.height, -1),
      goals_m_(goals_m.begin(), goals_m.end()) {
  static const std::array<Step, 32> kSteps = make_steps();
  const int width = space.frame.width;
  // Ordered by distance, then cell index: equal distances do not depend on the heap.
  using Entry = std::pair<float, std::int32_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  const auto offer = [&](int i, int j, float d_m, std::int32_t next, std::int32_t goal) {
    if (d_m >= distance_m_(i, j)) return;
    distance_m_(i, j) = d_m;
    next_(i, j) = next;
    goal_(i, j) = goal;
    open.emplace(d_m, j * width + i);
  };
  for (std::size_t g = 0; g < goals_m_.size(); ++g) {
    const glm::ivec2 cell = space.nearest_free(goals_m_[g], goal_snap_m);
    if (cell.x < 0) continue;
    // The cells around the goal start with their exact distance, so that where in its cell it
    // lies does not matter.
    for (int j = cell.y - 1; j <= cell.y + 1; ++j) {
      for (int i = cell.x - 1; i <= cell.x + 1; ++i) {
        if (!space.frame.contains({i, j}) || space.free(i, j) == 0) continue;
        if ((i != cell.x || j != cell.y) &&
            (space.free(i, cell.y) == 0 || space.free(cell.x, j) == 0)) {
          continue;
        }
        const double d_m = glm::distance(space.frame.center_m(i, j), goals_m_[g]);
        offer(i, j, static_cast<float>(d_m), j * width + i, static_cast<std::int32_t>(g));
      }
    }
  }
  while (!open.empty()) {
    const auto [d_m, index] = open.top();
    open.pop();
    const int i = index % width;
    const int j = index / width;
    if (d_m > distance_m_(i, j)) continue;
    for (const Step& step : kSteps) {
      if (!step_is_free(space.free, i, j, step)) continue;
      offer(i + step.di, j + step.dj,
            d_m + step.length_cells * static_cast<float>(space.frame.cell_m), index,
            goal_(i, j));
    }
  }
}

double DistanceField::at(const glm::dvec2& p_m, double snap_m) const {
  const GridFrame& frame = space_->frame;
  const glm::dvec2 g = (p_m - frame.origin_m) / frame.cell_m - 0.5;
  const int i = static_cast<int>(std::floor(g.x));
  const int j = static_cast<int>(std::floor(g.y));
  if (i >= 0 && j >= 0 && i + 1 < frame.width && j + 1 < frame.height) {
    const double fx = g.x - i;
    const double fy = g.y - j;
    const double value =
        (1 - fy) * ((1 - fx) * distance_m_(i, j) + fx * distance_m_(i + 1, j)) +
        fy * ((1 - fx) * distance_m_(i, j + 1) + fx * distance_m_(i + 1, j + 1));
    // A corner that is not free is infinite and spoils the sum (times 0 it is NaN).
    if (std::isfinite(value)) {
      // Near a goal the distance has a kink that interpolation would round off.
      double straight_m = std::numeric_limits<double>::infinity();
      const std::int32_t goal = goal_(i, j);
      if (goal >= 0) straight_m = glm::distance(goals_m_[static_cast<std::size_t>(goal)], p_m);
      return straight_m < 2.0 * frame.cell_m ? straight_m : value;
    }
  }
  // Cells near the point, each with the way to it; the shortest sum counts.
  const glm::ivec2 cell = frame.cell_of(p_m);
  const int span = static_cast<int>(std::ceil(snap_m / frame.cell_m)) + 1;
  double best_m = std::numeric_limits<double>::infinity();
  const glm::ivec2 nearest = space_->nearest_free(p_m, snap_m);
  if (nearest.x < 0) return best_m;
  const int island = space_->island(nearest.x, nearest.y);
  for (int b = std::max(0, cell.y - span); b <= std::min(frame.height - 1, cell.y + span);
       ++b) {
    for (int a = std::max(0, cell.x - span); a <= std::min(frame.width - 1, cell.x + span);
         ++a) {
      if (space_->island(a, b) != island) continue;
      const double way_m = glm::distance(frame.center_m(a, b), p_m);
      if (way_m <= snap_m) best_m = std::min(best_m, way_m + distance_m_(a, b));
    }
  }
  return best_m;
}

std::vector<glm::dvec2> DistanceField::path_from(const glm::dvec2& p_m, double snap_m) const {
  const GridFrame& frame = space_->frame;
  const glm::ivec2 start = space_->nearest_free(p_m, snap_m);
  if (start.x < 0 || goal_(start.x, start.y) < 0) return {};
  std::vector<glm::dvec2> cells = {p_m};
  std::int32_t index = start.y * frame.width + start.x;
  const std::int32_t goal = goal_(start.x, start.y);
  while (true) {
    const int i = index % frame.width;
    const int j = index / frame.width;
    cells.push_back(frame.center_m(i, j));
    const std::int32_t next = next_(i, j);
    if (next == index) break;
    index = next;
  }
  cells.push_back(goals_m_[static_cast<std::size_t>(goal)]);

  // String pulling: from each corner to the farthest later point that it sees, and at least
  // one on.
  std::vector<glm::dvec2> corners = {cells.front()};
  std::size_t at = 0;
  while (at + 1 < cells.size()) {
    std::size_t farthest = at + 1;
    for (std::size_t k = at + 2; k < cells.size(); ++k) {
      if (sees(*space_, cells[at], cells[k])) farthest = k;
    }
    at = farthest;
    corners.push_back(cells[at]);
  }
  return corners;
}

}  // namespace segsim::sim
