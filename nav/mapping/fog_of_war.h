#pragma once

/// @file
/// Which cells a view reveals, as VLFM decides it (frontier_exploration at 8523aa8): a
/// circular sector, cut by lines from the outlines of the obstacles in it, of which the piece
/// at the robot counts. No depth is used.

#include "core/image.h"
#include "nav/grid/grid_layer.h"
#include "nav/mapping/vlfm_rules.h"

namespace segsim::nav {

struct FogOptions {
  double hfov_rad = 1.378810109;  ///< 79 degrees.
  double range_m = 5.0;
  double overshoot = 1.05;  ///< Length of the cuts, in ranges.
  int cut_thickness_cells = 2;
  double max_gap_cells = 3.0;  ///< The piece must come this near to the robot.
};

/// A window of the map.
struct CellWindow {
  Cell low{0};                      ///< Of its first cell, in the map.
  core::Image<std::uint8_t> cells;  ///< 1 = revealed.
};

/// Cells that become visible from `position_m`, looking along `yaw_rad`.
///
/// OpenCV rounds the sector's ends to whole degrees, half to even, so the opening of 79
/// degrees becomes 78 to 80. Where the sector holds no obstacle the published rule reveals
/// nothing (Q3); the fixed one reveals the sector.
/// @param navigable  1 where the robot's centre may be.
[[nodiscard]] CellWindow revealed_cells(const GridFrame& frame,
                                        const GridView<std::uint8_t>& navigable,
                                        const glm::dvec2& position_m, double yaw_rad,
                                        const FogOptions& options, const VlfmRules& rules);

}  // namespace segsim::nav
