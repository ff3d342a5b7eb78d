#pragma once

/// @file
/// Shortest paths on the cost map: A* (8 neighbours, octile heuristic) and the Dijkstra field
/// from the robot that frontier choice needs. The cost of a step is its length times the mean
/// of the two cells' CostMap::length_cost.

#include <optional>
#include <vector>

#include "nav/cost_map.h"

namespace segsim::nav {

struct Path {
  std::vector<glm::dvec2> points_m;  ///< From the start to the goal, Odom.
  double length_m = 0.0;             ///< Euclidean, after shortening.
  double cost_m = 0.0;               ///< Weighted length on the grid, before shortening.
};

/// Distances from one cell over traversable cells.
struct GeodesicField {
  Cell start{0};              ///< Where the search began: after escaping from inflation.
  core::Image<float> cost_m;  ///< Weighted by length_cost; infinity where unreachable.
  [[nodiscard]] bool reachable(const Cell& cell) const;
};

/// The traversable cell that is reached first from `from` through cells that are not occupied
/// (`from` itself if it is traversable); nullopt if none lies within `limit_m`.
[[nodiscard]] std::optional<Cell> nearest_traversable(const CostMap& map, const Cell& from,
                                                      double limit_m = 1.0);

/// Weighted distances to all cells; nullopt if the start cannot escape to a traversable cell.
[[nodiscard]] std::optional<GeodesicField> geodesic_field(const CostMap& map,
                                                          const Cell& from);

/// A* from the start (which may lie inside inflation: the path begins with the way out) to the
/// cell of the goal; nullopt if there is no way. The result is shortened by line of sight.
[[nodiscard]] std::optional<Path> plan_path(const CostMap& map, const glm::dvec2& start_odom_m,
                                            const glm::dvec2& goal_odom_m);

/// Cells of the cheapest path, both ends included; nullopt if there is none. Both ends must be
/// traversable.
[[nodiscard]] std::optional<std::vector<Cell>> astar_cells(const CostMap& map,
                                                           const Cell& start,
                                                           const Cell& goal);

/// Weighted cost of a chain of neighbouring cells [m].
[[nodiscard]] double chain_cost_m(const CostMap& map, const std::vector<Cell>& cells);

/// Whether every cell that the segment touches is traversable.
[[nodiscard]] bool segment_traversable(const CostMap& map, const glm::dvec2& a_m,
                                       const glm::dvec2& b_m);

}  // namespace segsim::nav
