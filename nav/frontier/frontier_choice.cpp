#include "nav/frontier/frontier_choice.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include <glm/geometric.hpp>

namespace segsim::nav {
namespace {

constexpr double kPlaceStep_m = 0.05;
constexpr double kValueStep = 1e-3;

std::size_t position_of_smallest(std::span<const std::size_t> list,
                                 const std::function<double(std::size_t)>& length_m) {
  std::vector<double> lengths_m;
  for (const std::size_t k : list) lengths_m.push_back(length_m(k));
  return static_cast<std::size_t>(std::min_element(lengths_m.begin(), lengths_m.end()) -
                                  lengths_m.begin());
}

}  // namespace

bool AcyclicMemory::seen(const glm::dvec2& robot_m, const glm::dvec2& frontier_m,
                         double best_value, double second_value) const {
  if (rules_.published(Quirk::kAcyclicMemory)) return false;
  return states_.count(
             {std::lround(robot_m.x / kPlaceStep_m), std::lround(robot_m.y / kPlaceStep_m),
              std::lround(frontier_m.x / kPlaceStep_m),
              std::lround(frontier_m.y / kPlaceStep_m), std::lround(best_value / kValueStep),
              std::lround(second_value / kValueStep)}) != 0;
}

void AcyclicMemory::add(const glm::dvec2& robot_m, const glm::dvec2& frontier_m,
                        double best_value, double second_value) {
  if (rules_.published(Quirk::kAcyclicMemory)) return;  // Could only grow.
  states_.insert(
      {std::lround(robot_m.x / kPlaceStep_m), std::lround(robot_m.y / kPlaceStep_m),
       std::lround(frontier_m.x / kPlaceStep_m), std::lround(frontier_m.y / kPlaceStep_m),
       std::lround(best_value / kValueStep), std::lround(second_value / kValueStep)});
}

FrontierChooser::FrontierChooser(const FrontierChoiceOptions& options, const VlfmRules& rules)
    : options_(options), rules_(rules), memory_(rules) {}

void FrontierChooser::reset() {
  memory_.reset();
  last_.reset();
}

/// The last choice, if it is still there or one lies near it, and it has not lost value.
std::optional<std::size_t> FrontierChooser::sticky(std::span<const ValuedFrontier> frontiers,
                                                   std::span<const std::size_t> order) const {
  if (!last_) return std::nullopt;
  std::optional<std::size_t> nearest;
  double nearest_m = options_.stick_radius_m;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const double moved_m = glm::distance(frontiers[order[k]].place_m, last_->place_m);
    if (moved_m <= nearest_m) {
      if (nearest && moved_m == nearest_m) continue;
      nearest = k;
      nearest_m = moved_m;
    }
  }
  if (!nearest) return std::nullopt;
  const double value = frontiers[order[*nearest]].value;
  return value + options_.stick_margin > last_->value ? nearest : std::nullopt;
}

/// The best one whose state does not come back; among ties the nearest. The ways of the others
/// are asked for only if it does.
std::optional<std::size_t> FrontierChooser::first_unseen(
    std::span<const ValuedFrontier> frontiers, const FloorWays& ways,
    const std::function<bool(std::size_t)>& seen, std::vector<std::size_t>& order) const {
  const double best_value = frontiers[order.front()].value;
  const auto first_worse = std::find_if(order.begin(), order.end(), [&](std::size_t k) {
    return frontiers[k].value < best_value - options_.tie_margin;
  });
  const auto ties =
      options_.tie_margin > 0.0 ? static_cast<std::size_t>(first_worse - order.begin()) : 0;
  for (std::size_t k = 0; k < order.size(); ++k) {
    if (k + 1 < ties) {
      const std::span<const std::size_t> rest(order.data() + k, ties - k);
      const auto at = order.begin() + static_cast<std::ptrdiff_t>(k);
      const auto nearest = at + static_cast<std::ptrdiff_t>(ways.nearest(rest));
      std::rotate(at, nearest, nearest + 1);
    }
    if (!seen(order[k])) return k;
  }
  return std::nullopt;
}

/// All are vetoed.
std::size_t FrontierChooser::fallback(const FloorWays& ways,
                                      std::span<const std::size_t> order) const {
  std::vector<std::size_t> listed(order.size());
  std::iota(listed.begin(), listed.end(), std::size_t{0});
  if (rules_.published(Quirk::kVetoFallback)) {
    // The index of the farthest in the unsorted list, used in the sorted one.
    std::vector<double> lengths_m;
    lengths_m.reserve(listed.size());
    for (const std::size_t k : listed) lengths_m.push_back(ways.length_m(k));
    return static_cast<std::size_t>(std::max_element(lengths_m.begin(), lengths_m.end()) -
                                    lengths_m.begin());
  }
  const std::size_t nearest = listed[ways.nearest(listed)];
  return static_cast<std::size_t>(std::find(order.begin(), order.end(), nearest) -
                                  order.begin());
}

std::optional<std::size_t> FrontierChooser::choose(const glm::dvec2& robot_m,
                                                   std::span<const ValuedFrontier> frontiers,
                                                   const FloorWays& asked) {
  if (frontiers.empty()) {
    last_.reset();
    return std::nullopt;
  }
  FloorWays ways = asked;
  if (!ways.length_m) {
    ways.length_m = [&](std::size_t k) {
      return glm::distance(frontiers[k].place_m, robot_m);
    };
  }
  if (!ways.nearest) {
    ways.nearest = [&](std::span<const std::size_t> list) {
      return position_of_smallest(list, ways.length_m);
    };
  }
  std::vector<std::size_t> order(frontiers.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return frontiers[a].value > frontiers[b].value;
  });
  const double best_value = frontiers[order.front()].value;
  const double second_value = frontiers[order[order.size() > 1 ? 1 : 0]].value;
  const auto seen = [&](std::size_t k) {
    return memory_.seen(robot_m, frontiers[k].place_m, best_value, second_value);
  };
  // Mostly the last choice stays, and no way is asked for.
  std::optional<std::size_t> chosen = sticky(frontiers, order);
  if (!chosen) chosen = first_unseen(frontiers, ways, seen, order);
  const std::size_t index = order[chosen ? *chosen : fallback(ways, order)];
  memory_.add(robot_m, frontiers[index].place_m, best_value, second_value);
  last_ = frontiers[index];
  return index;
}

}  // namespace segsim::nav
