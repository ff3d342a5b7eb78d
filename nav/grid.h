#pragma once

/// @file
/// Cells of the planar maps. Cell (i, j) covers [origin + i r, origin + (i + 1) r) along x and
/// the same with j along y, frame Odom; images of cells are indexed (i, j) = (x, y).

#include <cmath>

#include <glm/vec2.hpp>

#include "core/image.h"

namespace segsim::nav {

/// Index of a cell: x along Odom x, y along Odom y.
using Cell = glm::ivec2;

/// Where the cells of a map lie in Odom.
struct GridFrame {
  double resolution_m = 0.05;
  glm::dvec2 origin_m{0.0};  ///< Corner (min x, min y) of cell (0, 0).
  int width_cells = 0;       ///< Along x.
  int height_cells = 0;      ///< Along y.

  [[nodiscard]] bool contains(const Cell& cell) const {
    return cell.x >= 0 && cell.y >= 0 && cell.x < width_cells && cell.y < height_cells;
  }
  /// The cell that covers the point; may lie outside of the map.
  [[nodiscard]] Cell cell_at(const glm::dvec2& p_odom_m) const {
    return {static_cast<int>(std::floor((p_odom_m.x - origin_m.x) / resolution_m)),
            static_cast<int>(std::floor((p_odom_m.y - origin_m.y) / resolution_m))};
  }
  /// Centre of the cell.
  [[nodiscard]] glm::dvec2 center_m(const Cell& cell) const {
    return {origin_m.x + (cell.x + 0.5) * resolution_m,
            origin_m.y + (cell.y + 0.5) * resolution_m};
  }
};

/// What is known about a cell; the numbers are those of core::PolicyView::cells.
enum class CellState : std::uint8_t { kUnknown = 0, kFree = 1, kOccupied = 2 };

}  // namespace segsim::nav
