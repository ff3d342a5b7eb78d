#include "nav/mapping/occupancy_map.h"

#include <algorithm>

#include "core/check.h"

namespace segsim::nav {
namespace {

constexpr HitHeights kUnread{0.0F, 0.0F, 0.0F, 0.0F};  // Zeros take no memory.

/// Calls `visit(i, j)` for the cells whose centres lie within the disc, inside the map.
template <class Visit>
void for_each_cell_in_disc(const GridFrame& frame, const glm::dvec2& center_m, double radius_m,
                           const Visit& visit) {
  const Cell low = frame.cell_at(center_m - radius_m);
  const Cell high = frame.cell_at(center_m + radius_m);
  for (int j = std::max(low.y, 0); j <= std::min(high.y, frame.height_cells - 1); ++j) {
    for (int i = std::max(low.x, 0); i <= std::min(high.x, frame.width_cells - 1); ++i) {
      const glm::dvec2 offset = frame.center_m({i, j}) - center_m;
      if (glm::dot(offset, offset) <= radius_m * radius_m) visit(i, j);
    }
  }
}

}  // namespace

OccupancyMap::OccupancyMap(const OccupancyOptions& options) : options_(options) {
  SEGSIM_CHECK(options.growth.resolution_m > 0.0, "resolution_m");
  SEGSIM_CHECK(!options.growth.wrap, "a log-odds map does not wrap");
  SEGSIM_CHECK(options.obstacle_max_m > options.obstacle_min_m, "obstacle band is empty");
  SEGSIM_CHECK(options.max_range_m > 0.0, "max_range_m");
  SEGSIM_CHECK(options.ray_step_x_px > 0 && options.ray_step_y_px > 0, "ray step");
  SEGSIM_CHECK(options.log_odds_hit > options.occupied_above &&
                   -options.log_odds_miss < options.free_below,
               "one observation must decide an unknown cell");
  reset();
}

void OccupancyMap::reset() {
  frame_ = {};
  frame_.resolution_m = options_.growth.resolution_m;
  body_ = {};
  mast_ = {};
  obstacles_ = {};
  heights_ = {};
  hole_views_ = {};
  observed_ = changed_ = {};
  started_ = exhausted_ = false;
}

bool OccupancyMap::ensure_covers(const glm::dvec2& low_m, const glm::dvec2& high_m) {
  if (frame_.width_cells == 0) frame_ = first_frame(options_.growth, 0.5 * (low_m + high_m));
  const auto margins = grow(frame_, options_.growth, low_m, high_m);
  exhausted_ |= !margins;
  body_.cover(frame_, margins);
  mast_.cover(frame_, margins);
  obstacles_.cover(frame_, margins);
  heights_.cover(frame_, margins, kUnread);
  hole_views_.cover(frame_, margins);
  return margins.has_value();
}

void OccupancyMap::note_changed(const Cell& cell) { changed_.add(cell + frame_.lattice()); }

CellBox OccupancyMap::observed() const {
  if (observed_.empty()) return {};
  const Cell lattice = frame_.lattice();
  return {observed_.low - lattice, observed_.high - lattice};
}

CellBox OccupancyMap::take_changed() {
  const Cell lattice = frame_.lattice();
  const CellBox changed = changed_;
  changed_ = {};
  if (changed.empty()) return {};
  return {changed.low - lattice, changed.high - lattice};
}

void OccupancyMap::mark_free_disc(const glm::dvec2& center_odom_m, double radius_m) {
  if (!ensure_covers(center_odom_m - radius_m, center_odom_m + radius_m)) return;
  for_each_cell_in_disc(frame_, center_odom_m, radius_m, [&](int i, int j) {
    body_(i, j) = mast_(i, j) = options_.log_odds_min;
    obstacles_(i, j) = 0;
    note_changed({i, j});
    observed_.add(Cell(i, j) + frame_.lattice());
  });
}

void OccupancyMap::mark_blocked_disc(const glm::dvec2& center_odom_m, double radius_m) {
  if (!ensure_covers(center_odom_m - radius_m, center_odom_m + radius_m)) return;
  for_each_cell_in_disc(frame_, center_odom_m, radius_m, [&](int i, int j) {
    body_(i, j) = kBlocked;
    note_changed({i, j});
    observed_.add(Cell(i, j) + frame_.lattice());
  });
}

void OccupancyMap::forget_blocked() {
  for (int j = 0; j < frame_.height_cells; ++j) {
    for (int i = 0; i < frame_.width_cells; ++i) {
      if (body_(i, j) < kBlocked) continue;
      body_(i, j) = 0.0F;
      note_changed({i, j});
    }
  }
}

void OccupancyMap::assume_free_disc(const glm::dvec2& center_odom_m, double radius_m) {
  for_each_cell_in_disc(frame_, center_odom_m, radius_m, [&](int i, int j) {
    if (body_(i, j) != 0.0F) return;
    body_(i, j) = kAssumedFree;
    note_changed({i, j});
    observed_.add(Cell(i, j) + frame_.lattice());
  });
}

CellState OccupancyMap::body_state(const Cell& cell) const {
  if (!frame_.contains(cell)) return CellState::kUnknown;
  const float odds = body_(cell.x, cell.y);
  if (odds > options_.occupied_above) return CellState::kOccupied;
  return odds < options_.free_below ? CellState::kFree : CellState::kUnknown;
}

}  // namespace segsim::nav
