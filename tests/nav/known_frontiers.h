#pragma once

/// @file
/// Frontiers of which everything is known, as an oracle for a selector that asks for little.

#include <vector>

#include "nav/frontier/frontiers.h"

namespace segsim::nav::test {

/// The reachable frontiers with the distances that the field gives them.
inline std::vector<Frontier> known_frontiers(const CostMap& map, const GeodesicField& field,
                                             const FrontierOptions& options = {}) {
  std::vector<Frontier> frontiers = find_reachable_frontiers(map, field, options);
  for (Frontier& frontier : frontiers) {
    frontier.distance_m =
        static_cast<double>(field.cost_m(frontier.waypoint.x, frontier.waypoint.y));
  }
  return frontiers;
}

}  // namespace segsim::nav::test
