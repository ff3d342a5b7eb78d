#include "nav/frontier_choice.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include <glm/geometric.hpp>

namespace segsim::nav {
namespace {

constexpr double kPlaceStep_m = 0.05;
constexpr double kValueStep = 1e-3;

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
std::optional<std::size_t> FrontierChooser::sticky(
    std::span<const ValuedFrontier> sorted) const {
  if (!last_) return std::nullopt;
  std::optional<std::size_t> nearest;
  double nearest_m = options_.stick_radius_m;
  for (std::size_t k = 0; k < sorted.size(); ++k) {
    const double moved_m = glm::distance(sorted[k].place_m, last_->place_m);
    if (moved_m <= nearest_m) {
      if (nearest && moved_m == nearest_m) continue;
      nearest = k;
      nearest_m = moved_m;
    }
  }
  if (nearest && sorted[*nearest].value + options_.stick_margin > last_->value) return nearest;
  return std::nullopt;
}

std::optional<std::size_t> FrontierChooser::choose(
    const glm::dvec2& robot_m, std::span<const ValuedFrontier> frontiers,
    const std::function<double(const glm::dvec2&)>& distance_m) {
  if (frontiers.empty()) {
    last_.reset();
    return std::nullopt;
  }
  // Each is asked for once: a distance along the floor takes a search.
  std::vector<std::optional<double>> away(frontiers.size());
  const auto away_m = [&](std::size_t k) {
    const glm::dvec2& place_m = frontiers[k].place_m;
    if (!away[k]) {
      away[k] = distance_m ? distance_m(place_m) : glm::distance(place_m, robot_m);
    }
    return *away[k];
  };
  // Descending value; equal ones nearest first, or in the order of the list.
  std::vector<std::size_t> order(frontiers.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return frontiers[a].value > frontiers[b].value;
  });
  const double best_value = frontiers[order.front()].value;
  const double second_value = order.size() > 1 ? frontiers[order[1]].value : best_value;
  const auto in_order = [&] {
    std::vector<ValuedFrontier> sorted;
    for (const std::size_t k : order) sorted.push_back(frontiers[k]);
    return sorted;
  };
  // Mostly the last choice stays, and no distance is needed.
  std::vector<ValuedFrontier> sorted = in_order();
  std::optional<std::size_t> chosen = sticky(sorted);
  if (!chosen && options_.tie_margin > 0.0) {
    const auto end = std::find_if(order.begin(), order.end(), [&](std::size_t k) {
      return frontiers[k].value < best_value - options_.tie_margin;
    });
    std::stable_sort(order.begin(), end,
                     [&](std::size_t a, std::size_t b) { return away_m(a) < away_m(b); });
    sorted = in_order();
  }
  for (std::size_t k = 0; !chosen && k < sorted.size(); ++k) {
    if (!memory_.seen(robot_m, sorted[k].place_m, best_value, second_value)) chosen = k;
  }
  if (!chosen) {  // All vetoed.
    for (std::size_t k = 0; k < frontiers.size(); ++k) (void)away_m(k);
    if (rules_.published(Quirk::kVetoFallback)) {
      // The index of the farthest in the unsorted list, used in the sorted one.
      chosen =
          static_cast<std::size_t>(std::max_element(away.begin(), away.end()) - away.begin());
    } else {
      const auto nearest =
          static_cast<std::size_t>(std::min_element(away.begin(), away.end()) - away.begin());
      chosen = static_cast<std::size_t>(std::find(order.begin(), order.end(), nearest) -
                                        order.begin());
    }
  }
  memory_.add(robot_m, sorted[*chosen].place_m, best_value, second_value);
  last_ = sorted[*chosen];
  return order[*chosen];
}

}  // namespace segsim::nav
