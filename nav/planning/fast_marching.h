#pragma once

/// @file
/// Arrival times of a front from a goal (fast marching, Sethian 1996): |grad T| = cost, solved
/// first order on the grid. Unlike Dijkstra's, distances do not depend on the direction of the
/// grid's axes, and their slope leads to the goal from everywhere.

#include <optional>
#include <vector>

#include "nav/planning/cost_map.h"

namespace segsim::nav {

/// Weighted distance of every cell to the nearest goal [m]; infinity where there is no way.
/// The weights are CostMap::length_cost.
/// @param goals  Cells that are not traversable are left out.
[[nodiscard]] core::Image<float> fast_marching_m(const CostMap& map,
                                                 const std::vector<Cell>& goals);

/// The cell within `reach_cells` of `from` with the smallest distance to the goal that a
/// straight line over traversable cells leads to: SemExp's short-term goal (its reach: 5
/// cells). nullopt where no cell is nearer to the goal than `from`.
[[nodiscard]] std::optional<Cell> short_term_goal(const CostMap& map,
                                                  const core::Image<float>& distance_m,
                                                  const Cell& from, int reach_cells = 5);

}  // namespace segsim::nav
