#include "nav/frontiers.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::nav {
namespace {

/// Unknown cells in which the robot would fit, without the pockets that count as free.
core::Image<std::uint8_t> worthwhile_unknown(const CostMap& map) {
  core::Image<std::uint8_t> unknown(map.frame().width_cells, map.frame().height_cells);
  for (std::size_t k = 0; k < unknown.size(); ++k) {
    unknown.data()[k] = map.states().data()[k] == CellState::kUnknown &&
                                map.clear_cells().data()[k] != 0 &&
                                map.traversable_cells().data()[k] == 0
                            ? 1
                            : 0;
  }
  return unknown;
}

/// Neighbour offsets around a cell.
constexpr int kDx[8] = {1, 1, 0, -1, -1, -1, 0, 1};
constexpr int kDy[8] = {0, 1, 1, 1, 0, -1, -1, -1};

/// Marks (1) the cells of `run` in `mask`, visits them breadth first from `first` inside the
/// mask and returns them in that order; the visited ones are set to 2.
std::vector<Cell> flood(core::Image<std::uint8_t>& mask, const Cell& first) {
  std::vector<Cell> order{first};
  mask(first.x, first.y) = 2;
  for (std::size_t k = 0; k < order.size(); ++k) {
    for (int n = 0; n < 8; ++n) {
      const Cell next(order[k].x + kDx[n], order[k].y + kDy[n]);
      if (!mask.contains(next.x, next.y) || mask(next.x, next.y) != 1) continue;
      mask(next.x, next.y) = 2;
      order.push_back(next);
    }
  }
  return order;
}

/// Cells of a run ordered from one of its ends.
std::vector<Cell> ordered_from_end(core::Image<std::uint8_t>& mask, std::vector<Cell> run) {
  const Cell end = run.back();
  for (const Cell& cell : run) mask(cell.x, cell.y) = 1;
  return flood(mask, end);
}

Frontier describe(const CostMap& map, const GeodesicField& field,
                  const core::Image<std::uint8_t>& unknown, const std::vector<Cell>& cells) {
  glm::dvec2 middle(0.0), outward(0.0);
  for (const Cell& cell : cells) {
    middle += glm::dvec2(cell);
    for (int n = 0; n < 8; ++n) {
      const Cell next(cell.x + kDx[n], cell.y + kDy[n]);
      if (unknown.contains(next.x, next.y) && unknown(next.x, next.y) != 0) {
        outward += glm::dvec2(kDx[n], kDy[n]);
      }
    }
  }
  middle /= static_cast<double>(cells.size());
  const auto distance2 = [&](const Cell& cell) {
    const glm::dvec2 offset = glm::dvec2(cell) - middle;
    return glm::dot(offset, offset);
  };
  Frontier frontier;
  frontier.waypoint = *std::min_element(
      cells.begin(), cells.end(),
      [&](const Cell& a, const Cell& b) { return distance2(a) < distance2(b); });
  frontier.waypoint_m = map.frame().center_m(frontier.waypoint);
  const double norm = glm::length(outward);
  frontier.outward = norm > 0.5 ? outward / norm : glm::dvec2(0.0);
  frontier.length_m = static_cast<double>(cells.size()) * map.frame().resolution_m;
  frontier.distance_m =
      static_cast<double>(field.cost_m(frontier.waypoint.x, frontier.waypoint.y));
  return frontier;
}

}  // namespace

std::vector<Frontier> find_frontiers(const CostMap& map, const GeodesicField& field,
                                     const FrontierOptions& options) {
  SEGSIM_CHECK(field.cost_m.size() == map.states().size(), "field and map differ in size");
  const int width = map.frame().width_cells, height = map.frame().height_cells;
  const core::Image<std::uint8_t> unknown = worthwhile_unknown(map);

  // Reachable cells next to the unknown.
  core::Image<std::uint8_t> border(width, height);
  for (int j = 1; j + 1 < height; ++j) {
    for (int i = 1; i + 1 < width; ++i) {
      if (!std::isfinite(field.cost_m(i, j))) continue;
      for (int n = 0; n < 8; ++n) {
        if (unknown(i + kDx[n], j + kDy[n]) != 0) {
          border(i, j) = 1;
          break;
        }
      }
    }
  }

  // Contiguous runs, cut where they are long.
  std::vector<Frontier> frontiers;
  const double resolution = map.frame().resolution_m;
  for (int j = 0; j < height; ++j) {
    for (int i = 0; i < width; ++i) {
      if (border(i, j) != 1) continue;
      std::vector<Cell> run = flood(border, {i, j});
      const double length_m = static_cast<double>(run.size()) * resolution;
      if (length_m < options.min_length_m) continue;
      const auto parts =
          static_cast<std::size_t>(std::max(1.0, std::ceil(length_m / options.max_length_m)));
      if (parts > 1) run = ordered_from_end(border, std::move(run));
      for (std::size_t part = 0; part < parts; ++part) {
        const auto first = static_cast<std::ptrdiff_t>(run.size() * part / parts);
        const auto last = static_cast<std::ptrdiff_t>(run.size() * (part + 1) / parts);
        frontiers.push_back(
            describe(map, field, unknown, {run.begin() + first, run.begin() + last}));
      }
    }
  }
  return frontiers;
}

FrontierScorer make_nearest_scorer(const FrontierSelectorOptions& options) {
  return [options](const Frontier& frontier) {
    return options.size_bonus_m_per_m * std::min(frontier.length_m, options.size_cap_m) -
           frontier.distance_m;
  };
}

FrontierSelector::FrontierSelector(const FrontierSelectorOptions& options,
                                   FrontierScorer scorer)
    : options_(options), scorer_(scorer ? std::move(scorer) : make_nearest_scorer(options)) {}

void FrontierSelector::reset() {
  last_m_.reset();
  blacklist_.clear();
}

void FrontierSelector::blacklist(const glm::dvec2& waypoint_odom_m) {
  blacklist_.push_back(waypoint_odom_m);
}

bool FrontierSelector::blacklisted(const glm::dvec2& waypoint_odom_m) const {
  return std::any_of(blacklist_.begin(), blacklist_.end(), [&](const glm::dvec2& failed_m) {
    return glm::distance(failed_m, waypoint_odom_m) <= options_.blacklist_radius_m;
  });
}

std::optional<Frontier> FrontierSelector::select(std::vector<Frontier>& frontiers) {
  const Frontier* best = nullptr;
  const Frontier* kept = nullptr;
  double kept_distance_m = options_.stick_radius_m;
  for (Frontier& frontier : frontiers) {
    frontier.value = scorer_(frontier);
    if (blacklisted(frontier.waypoint_m)) continue;
    if (best == nullptr || frontier.value > best->value) best = &frontier;
    if (!last_m_) continue;
    const double moved_m = glm::distance(*last_m_, frontier.waypoint_m);
    if (moved_m <= kept_distance_m) {
      kept = &frontier;
      kept_distance_m = moved_m;
    }
  }
  if (best == nullptr) {
    last_m_.reset();
    return std::nullopt;
  }
  const Frontier& chosen =
      kept != nullptr && kept->value + options_.stick_margin >= best->value ? *kept : *best;
  last_m_ = chosen.waypoint_m;
  return chosen;
}

}  // namespace segsim::nav
