#include "sim/trial/oracle_way.h"

#include <cmath>

#include <glm/geometric.hpp>

namespace segsim::sim {
namespace {

double length_m(const std::vector<glm::dvec2>& corners) {
  double sum_m = 0.0;
  for (std::size_t k = 1; k < corners.size(); ++k) {
    sum_m += glm::distance(corners[k - 1], corners[k]);
  }
  return sum_m;
}

}  // namespace

OracleWay::OracleWay(const World& world, std::span<const glm::dvec2> goals_m)
    : shortest_(world.distance_to(goals_m)) {
  for (const double margin_m : kMargins_m) {
    spaces_.push_back(
        std::make_unique<const FreeSpace>(make_free_space(world.collision(), margin_m)));
    wider_.emplace_back(*spaces_.back(), goals_m);
  }
}

std::vector<glm::dvec2> OracleWay::from(const glm::dvec2& p_m) const {
  const double shortest_m = shortest_.at(p_m, kSnap_m);
  if (!std::isfinite(shortest_m)) return {};
  for (const DistanceField& field : wider_) {
    std::vector<glm::dvec2> way = field.path_from(p_m, kSnap_m);
    if (!way.empty() && length_m(way) <= kLongerShare * shortest_m + kLonger_m) return way;
  }
  return shortest_.path_from(p_m, kSnap_m);
}

}  // namespace segsim::sim
