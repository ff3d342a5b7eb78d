#pragma once

/// @file
/// Square cells on the floor, and the ways in which a mesh becomes such cells.

#include <cstdint>

#include <glm/vec2.hpp>

#include "core/image.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::sim {

/// Where a grid lies. Cell (i, j), i along x and j along y, covers
/// [origin + (i, j) cell, origin + (i + 1, j + 1) cell).
struct GridFrame {
  glm::dvec2 origin_m{0.0};
  double cell_m = 0.05;
  int width = 0, height = 0;  ///< Cells along x, along y.

  [[nodiscard]] glm::dvec2 center_m(int i, int j) const {
    return origin_m + cell_m * glm::dvec2(i + 0.5, j + 0.5);
  }
  [[nodiscard]] glm::ivec2 cell_of(const glm::dvec2& p_m) const;
  [[nodiscard]] bool contains(const glm::ivec2& cell) const {
    return cell.x >= 0 && cell.y >= 0 && cell.x < width && cell.y < height;
  }
};

/// Grid over the xy extent of a mesh plus `margin_m`; the origin is a multiple of the cell
/// size.
[[nodiscard]] GridFrame grid_over(const TriangleMesh& mesh, double cell_m, double margin_m);

using GridMask = core::Image<std::uint8_t>;  ///< 0 or 1 per cell; pixel (x, y) = cell (i, j).

/// Marks every cell that a triangle overlaps, in plan, with its part between the two heights.
/// Exact; a wall that stands on the line between two cells counts for the one with the larger
/// coordinate.
void mark_band(const TriangleMesh& mesh, double z_lo_m, double z_hi_m, const GridFrame& frame,
               GridMask& mask);

/// Marks every cell whose centre lies on a triangle that is nearly level (within 30 degrees)
/// and at |z| <= `z_tolerance_m`.
void mark_floor(const TriangleMesh& mesh, double z_tolerance_m, const GridFrame& frame,
                GridMask& mask);

/// Distance of each cell's centre to the centre of the nearest marked cell [m]; infinity if
/// there is none. Exact, linear time (Felzenszwalb & Huttenlocher 2012, "Distance transforms
/// of sampled functions").
[[nodiscard]] core::Image<float> distance_to_marked(const GridMask& mask, double cell_m);

/// 4-connected pieces of the marked cells, numbered from 1 in descending order of size (ties:
/// first in row order); 0 elsewhere.
[[nodiscard]] core::Image<std::int32_t> label_pieces(const GridMask& mask);

}  // namespace segsim::sim
