#include "nav/frontier/frontiers.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::nav {
namespace {

/// Unknown cells in which the robot would fit, without the pockets that count as free. Only
/// the active part is set.
core::Image<std::uint8_t> worthwhile_unknown(const CostMap& map, const CellBox& box) {
  core::Image<std::uint8_t> unknown(box.width(), box.height());
  for (int j = 0; j < box.height(); ++j) {
    const CellState* states = map.states().row(j + box.low.y) + box.low.x;
    const std::uint8_t* clear = map.clear_cells().row(j + box.low.y) + box.low.x;
    const std::uint8_t* traversable = map.traversable_cells().row(j + box.low.y) + box.low.x;
    std::uint8_t* row = unknown.row(j);
    for (int i = 0; i < box.width(); ++i) {
      row[i] = static_cast<std::uint8_t>(static_cast<int>(states[i] == CellState::kUnknown) &
                                         static_cast<int>(clear[i] != 0) &
                                         static_cast<int>(traversable[i] == 0));
    }
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

Frontier describe(const CostMap& map, const core::Image<std::uint8_t>& unknown,
                  const CellBox& box, const std::vector<Cell>& cells) {
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
  frontier.waypoint = box.low + *std::min_element(cells.begin(), cells.end(),
                                                  [&](const Cell& a, const Cell& b) {
                                                    return distance2(a) < distance2(b);
                                                  });
  frontier.waypoint_m = map.frame().center_m(frontier.waypoint);
  const double norm = glm::length(outward);
  frontier.outward = norm > 0.5 ? outward / norm : glm::dvec2(0.0);
  frontier.length_m = static_cast<double>(cells.size()) * map.frame().resolution_m;
  return frontier;
}

}  // namespace

std::vector<Frontier> find_reachable_frontiers(const CostMap& map, const GeodesicField& field,
                                               const FrontierOptions& options) {
  SEGSIM_CHECK(same_size(field.reachable_cells(), map.states()),
               "field and map differ in size");
  std::vector<Frontier> frontiers;
  if (field.reachable_box().empty()) return frontiers;
  // Cells of the frame's outermost rows and columns are never a border.
  const CellBox box = field.reachable_box().grown(1).clipped_to(map.frame().box());
  const int width = box.width(), height = box.height();
  const core::Image<std::uint8_t> unknown = worthwhile_unknown(map, box);

  // Reachable cells next to the unknown; whole rows at a time.
  core::Image<std::uint8_t> border(width, height);
  std::vector<std::uint8_t> beside(static_cast<std::size_t>(width));
  for (int j = 1; j + 1 < height; ++j) {
    const std::uint8_t *below = unknown.row(j - 1), *here = unknown.row(j),
                       *above = unknown.row(j + 1);
    for (int i = 0; i < width; ++i) {
      beside[static_cast<std::size_t>(i)] =
          static_cast<std::uint8_t>(below[i] | here[i] | above[i]);
    }
    const std::uint8_t* reachable = field.reachable_cells().row(j + box.low.y) + box.low.x;
    std::uint8_t* row = border.row(j);
    for (int i = 1; i + 1 < width; ++i) {
      const auto k = static_cast<std::size_t>(i);
      row[i] = static_cast<std::uint8_t>(reachable[i] &
                                         (beside[k - 1] | beside[k] | beside[k + 1]));
    }
  }

  // Contiguous runs, cut where they are long.
  const double resolution = map.frame().resolution_m;
  for (int j = 0; j < height; ++j) {
    for (const std::uint8_t* at = border.row(j); at != border.row(j) + width; ++at) {
      at = std::find(at, static_cast<const std::uint8_t*>(border.row(j) + width), 1);
      if (at == border.row(j) + width) break;
      std::vector<Cell> run = flood(border, {static_cast<int>(at - border.row(j)), j});
      const double length_m = static_cast<double>(run.size()) * resolution;
      if (length_m < options.min_length_m) continue;
      const auto parts =
          static_cast<std::size_t>(std::max(1.0, std::ceil(length_m / options.max_length_m)));
      if (parts > 1) run = ordered_from_end(border, std::move(run));
      for (std::size_t part = 0; part < parts; ++part) {
        const auto first = static_cast<std::ptrdiff_t>(run.size() * part / parts);
        const auto last = static_cast<std::ptrdiff_t>(run.size() * (part + 1) / parts);
        frontiers.push_back(
            describe(map, unknown, box, {run.begin() + first, run.begin() + last}));
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
    : options_(options),
      nearest_(!scorer),
      scorer_(scorer ? std::move(scorer) : make_nearest_scorer(options)) {}

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

const Frontier* FrontierSelector::last_among(const std::vector<Frontier>& frontiers) const {
  const Frontier* kept = nullptr;
  double kept_distance_m = options_.stick_radius_m;
  for (const Frontier& frontier : frontiers) {
    if (!last_m_ || blacklisted(frontier.waypoint_m)) continue;
    const double moved_m = glm::distance(*last_m_, frontier.waypoint_m);
    if (moved_m <= kept_distance_m) {
      kept = &frontier;
      kept_distance_m = moved_m;
    }
  }
  return kept;
}

/// Nothing beyond the settled distance is worth more than the size bonus less that distance.
void FrontierSelector::settle_enough(std::vector<Frontier>& frontiers,
                                     const GeodesicField& field) const {
  constexpr double kUnknown = std::numeric_limits<double>::infinity();
  std::vector<Frontier*> open;
  for (Frontier& frontier : frontiers) {
    frontier.distance_m = kUnknown;
    open.push_back(&frontier);
  }
  const Frontier* kept = last_among(frontiers);
  const double most_bonus = options_.size_bonus_m_per_m * options_.size_cap_m;
  double best = -kUnknown;
  const auto take_settled = [&](Frontier* frontier) {
    if (!field.settled(frontier->waypoint)) return false;
    frontier->distance_m =
        static_cast<double>(field.cost_m(frontier->waypoint.x, frontier->waypoint.y));
    if (!blacklisted(frontier->waypoint_m)) best = std::max(best, scorer_(*frontier));
    return true;
  };
  while (true) {
    std::erase_if(open, take_settled);
    if (open.empty()) return;
    const double most = most_bonus - field.settled_below_m();
    const bool kept_decided =
        kept == nullptr || kept->distance_m != kUnknown || most + options_.stick_margin < best;
    if (nearest_ && best > most && kept_decided) return;
    if (!field.settle_more()) return;
  }
}

std::optional<Frontier> FrontierSelector::select(std::vector<Frontier>& frontiers,
                                                 const GeodesicField& field) {
  settle_enough(frontiers, field);
  return select(frontiers);
}

std::optional<Frontier> FrontierSelector::select(std::vector<Frontier>& frontiers) {
  const Frontier* best = nullptr;
  for (Frontier& frontier : frontiers) {
    frontier.value = scorer_(frontier);
    if (blacklisted(frontier.waypoint_m)) continue;
    if (best == nullptr || frontier.value > best->value) best = &frontier;
  }
  if (best == nullptr) {
    last_m_.reset();
    return std::nullopt;
  }
  const Frontier* kept = last_among(frontiers);
  const Frontier& chosen =
      kept != nullptr && kept->value + options_.stick_margin >= best->value ? *kept : *best;
  last_m_ = chosen.waypoint_m;
  return chosen;
}

}  // namespace segsim::nav
