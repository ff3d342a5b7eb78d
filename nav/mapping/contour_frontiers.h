#pragma once

/// @file
/// Frontiers as VLFM finds them (frontier_exploration at 8523aa8): runs along the outlines of
/// the explored area beside navigable cells that are not explored. nav/frontier/frontiers.h
/// holds the other notion, reachable cells next to the unknown.

#include <optional>
#include <vector>

#include "core/image.h"
#include "nav/grid/grid_layer.h"

namespace segsim::nav {

struct ContourFrontierOptions {
  double min_pocket_m2 = 1.5;       ///< Smaller unexplored pockets count as explored.
  int explored_dilation_cells = 5;  ///< Square applied before anything else.
  int blur_cells = 3;  ///< A cell touches the unexplored if this square around it does.
  int min_cells = 2;   ///< Shorter runs are dropped.
};

struct ContourFrontier {
  glm::dvec2 waypoint_m{0.0};  ///< Half way along the run, Odom.
  std::vector<Cell> cells;     ///< In order along the outline.
};

/// @param explored, navigable  0 or 1, of the frame's size.
/// @param within  Holds every explored cell; spares the search for them.
[[nodiscard]] std::vector<ContourFrontier> find_contour_frontiers(
    const GridFrame& frame, const GridView<std::uint8_t>& explored,
    const GridView<std::uint8_t>& navigable, const ContourFrontierOptions& options,
    const std::optional<CellBox>& within = std::nullopt);

/// The point at half the arc length of a polyline of cell centres, in cells.
[[nodiscard]] glm::dvec2 middle_along(const std::vector<Cell>& cells);

}  // namespace segsim::nav
