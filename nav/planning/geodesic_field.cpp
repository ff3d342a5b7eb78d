#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "nav/planning/grid_planner.h"

namespace segsim::nav {
namespace {

// Kept where no way leads: no more than any cost, so that the search never enters.
constexpr float kNoWay = 0.0F;

/// A stretch of traversable cells of one row.
struct Run {
  int y, x0, x1;
};

/// The first position from `x` to `last` where `set` is 1 and `but_not` is 0; `last` + 1 if
/// there is none. Eight at a time, as most rows next to a run were marked from its other end.
int first_set_beside(const std::uint8_t* set, const std::uint8_t* but_not, int x, int last) {
  for (; x + 7 <= last; x += 8) {
    std::uint64_t a = 0, b = 0;
    std::memcpy(&a, set + x, sizeof a);
    std::memcpy(&b, but_not + x, sizeof b);
    if ((a & ~b) != 0) break;
  }
  while (x <= last && (set[x] & ~but_not[x]) == 0) ++x;
  return x;
}

}  // namespace

bool GeodesicField::begin(const CostMap& map, const Cell& from) {
  // What the last search wrote lies in its box.
  for (int j = box_.low.y; j <= box_.high.y && !box_.empty(); ++j) {
    std::fill_n(cost_m_.row(j) + box_.low.x, box_.width(), kNoWay);
    std::fill_n(reachable_.row(j) + box_.low.x, box_.width(), std::uint8_t{0});
  }
  cost_m_.cover_like(map.length_costs());
  reachable_.cover_like(map.length_costs());
  for (auto& bucket : buckets_) bucket.clear();
  next_bucket_ = waiting_ = 0;
  map_ = &map;
  box_ = {};
  per_bucket_ = static_cast<float>(1.0 / map.frame().resolution_m);
  const std::optional<Cell> start = nearest_traversable(map, from);
  if (!start) return false;
  start_ = *start;
  spread_rows();
  cost_m_(start_.x, start_.y) = 0.0F;
  if (buckets_.empty()) buckets_.resize(64);
  buckets_[0].push_back({0.0F, static_cast<std::uint32_t>(cost_m_.index_of(start_))});
  waiting_ = 1;
  return true;
}

/// Marks everything that is joined to the start, a row's stretch at a time.
void GeodesicField::spread_rows() {
  const GridLayer<std::uint8_t>& open = map_->traversable_cells();
  const int width = open.width_cells(), height = open.height_cells();
  std::vector<Run> runs;
  const auto take_run_at = [&](int x, int y) {
    // The rim holds zeros, so that both ends are found.
    const std::uint8_t* row = open.row(y);
    const auto at = static_cast<std::size_t>(x);
    const auto left = static_cast<const std::uint8_t*>(memrchr(row - 1, 0, at + 1));
    const auto right = static_cast<const std::uint8_t*>(
        std::memchr(row + at, 0, static_cast<std::size_t>(width) + 1 - at));
    const int x0 = static_cast<int>(left + 1 - row), x1 = static_cast<int>(right - 1 - row);
    std::memset(reachable_.row(y) + x0, 1, static_cast<std::size_t>(x1 - x0 + 1));
    std::fill(cost_m_.row(y) + x0, cost_m_.row(y) + x1 + 1, kUnreachable_m);
    box_.add(Cell(x0, y));
    box_.add(Cell(x1, y));
    runs.push_back({y, x0, x1});
  };
  take_run_at(start_.x, start_.y);
  while (!runs.empty()) {
    const Run run = runs.back();
    runs.pop_back();
    for (const int y : {run.y - 1, run.y + 1}) {
      if (y < 0 || y >= height) continue;
      const std::uint8_t* row = open.row(y);
      const std::uint8_t* marked = reachable_.row(y);
      // Diagonal neighbours are joined, too.
      const int last = std::min(run.x1 + 1, width - 1);
      int x = first_set_beside(row, marked, std::max(run.x0 - 1, 0), last);
      while (x <= last) {
        take_run_at(x, y);
        x = first_set_beside(row, marked, runs.back().x1 + 1, last);
      }
    }
  }
}

bool GeodesicField::reachable(const Cell& cell) const {
  return reachable_.contains(cell.x, cell.y) && reachable_(cell.x, cell.y) != 0;
}

double GeodesicField::settled_below_m() const {
  return static_cast<double>(next_bucket_) / static_cast<double>(per_bucket_);
}

bool GeodesicField::settled(const Cell& cell) const {
  if (!reachable(cell)) return true;
  const float known = cost_m_(cell.x, cell.y);
  return std::isfinite(known) && bucket_of(known) < next_bucket_;
}

float GeodesicField::cost_m(int x, int y) const {
  if (!reachable({x, y})) return kUnreachable_m;
  while (!settled({x, y}) && settle_more()) {
  }
  return cost_m_(x, y);
}

/// The hot loop of the search.
void GeodesicField::relax_around(std::uint32_t from) const {
  const std::ptrdiff_t stride = cost_m_.stride();
  const auto resolution = static_cast<float>(map_->frame().resolution_m);
  const float half_straight = resolution * 1.0F * 0.5F,
              half_diagonal = resolution * std::numbers::sqrt2_v<float> * 0.5F;
  float* known = cost_m_.plane() + from;
  const float* costs = map_->length_costs().plane() + from;
  const float here = *known, cost_here = *costs;
  const auto relax = [&](std::ptrdiff_t step, float half_length) {
    // Most neighbours lie behind the front: no way leads back to them.
    if (known[step] <= here) return;
    const float there = here + half_length * (cost_here + costs[step]);
    if (there >= known[step]) return;
    known[step] = there;
    const std::size_t bucket = bucket_of(there);
    if (bucket >= buckets_.size()) buckets_.resize(bucket + 64);
    buckets_[bucket].push_back({there, static_cast<std::uint32_t>(from + step)});
    ++waiting_;
  };
  relax(-stride - 1, half_diagonal);
  relax(-stride, half_straight);
  relax(-stride + 1, half_diagonal);
  relax(-1, half_straight);
  relax(1, half_straight);
  relax(stride - 1, half_diagonal);
  relax(stride, half_straight);
  relax(stride + 1, half_diagonal);
}

bool GeodesicField::settle_more() const {
  return settle_bucket([](std::uint32_t) {});
}

std::optional<GeodesicField> geodesic_field(const CostMap& map, const Cell& from) {
  GeodesicField field;
  if (!field.begin(map, from)) return std::nullopt;
  return field;
}

}  // namespace segsim::nav
