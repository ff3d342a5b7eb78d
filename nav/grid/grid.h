#pragma once

/// @file
/// Cells of the planar maps. Cell (i, j) covers [origin + i r, origin + (i + 1) r) along x and
/// the same with j along y, frame Odom; images of cells are indexed (i, j) = (x, y).

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/common.hpp>
#include <glm/vec2.hpp>

#include "core/image.h"

namespace segsim::nav {

/// Index of a cell: x along Odom x, y along Odom y.
using Cell = glm::ivec2;

/// A rectangle of cells, both corners included. Empty at first.
struct CellBox {
  Cell low{std::numeric_limits<int>::max()}, high{std::numeric_limits<int>::min()};

  [[nodiscard]] bool empty() const { return low.x > high.x || low.y > high.y; }
  [[nodiscard]] bool contains(const Cell& cell) const {
    return cell.x >= low.x && cell.y >= low.y && cell.x <= high.x && cell.y <= high.y;
  }
  [[nodiscard]] int width() const { return high.x - low.x + 1; }
  [[nodiscard]] int height() const { return high.y - low.y + 1; }
  void add(const Cell& cell) {
    low = glm::min(low, cell);
    high = glm::max(high, cell);
  }
  void add(const CellBox& other) {
    if (other.empty()) return;
    add(other.low);
    add(other.high);
  }
  /// Larger by so many cells on each side; an empty box stays empty.
  [[nodiscard]] CellBox grown(int cells) const {
    return empty() ? *this : CellBox{low - cells, high + cells};
  }
  [[nodiscard]] CellBox clipped_to(const CellBox& other) const {
    return {glm::max(low, other.low), glm::min(high, other.high)};
  }
  bool operator==(const CellBox&) const = default;
};

/// Where the cells of a map lie in Odom.
struct GridFrame {
  double resolution_m = 0.05;
  glm::dvec2 origin_m{0.0};  ///< Corner (min x, min y) of cell (0, 0).
  int width_cells = 0;       ///< Along x.
  int height_cells = 0;      ///< Along y.

  [[nodiscard]] bool contains(const Cell& cell) const {
    return cell.x >= 0 && cell.y >= 0 && cell.x < width_cells && cell.y < height_cells;
  }
  /// Where cell (0, 0) lies on the lattice of all cells; differences tell how frames that grew
  /// from one another are shifted.
  [[nodiscard]] Cell lattice() const {
    return {static_cast<int>(std::floor(origin_m.x / resolution_m + 0.25)),
            static_cast<int>(std::floor(origin_m.y / resolution_m + 0.25))};
  }
  /// All cells.
  [[nodiscard]] CellBox box() const {
    return {Cell(0), Cell(width_cells - 1, height_cells - 1)};
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

/// Cells added on each side by a growth.
struct Margins {
  int left = 0, bottom = 0, right = 0, top = 0;
  [[nodiscard]] bool any() const { return left + bottom + right + top != 0; }
};

/// What is known about a cell; the numbers are those of core::PolicyView::cells.
enum class CellState : std::uint8_t { kUnknown = 0, kFree = 1, kOccupied = 2 };

}  // namespace segsim::nav
