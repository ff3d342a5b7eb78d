#pragma once

/// @file
/// Occupied voxels -> few large rectangles around them.

#include <cstdint>
#include <vector>

#include <glm/vec3.hpp>

#include "sim/ground/ground_grid.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::worlds {

/// Dense box of voxels; voxel (i, j, k) covers origin + cell * [(i, j, k), (i + 1, j + 1, k +
/// 1)).
struct VoxelBox {
  glm::dvec3 origin_m{0.0};
  double cell_m = 0.05;
  glm::ivec3 size{0};
  std::vector<std::uint8_t> occupied;  ///< [k][j][i]

  [[nodiscard]] bool at(const glm::ivec3& v) const {
    return v.x >= 0 && v.y >= 0 && v.z >= 0 && v.x < size.x && v.y < size.y && v.z < size.z &&
           occupied[index(v)] != 0;
  }
  [[nodiscard]] std::size_t index(const glm::ivec3& v) const {
    return (static_cast<std::size_t>(v.z) * static_cast<std::size_t>(size.y) +
            static_cast<std::size_t>(v.y)) *
               static_cast<std::size_t>(size.x) +
           static_cast<std::size_t>(v.x);
  }
};

/// Rectangles that cover exactly the marked cells, disjoint; greedy in row order: as wide as
/// possible, then as high as possible. Clears `mask`.
struct CellRectangle {
  int i0 = 0, j0 = 0, i1 = 0, j1 = 0;  ///< Half-open.
};
[[nodiscard]] std::vector<CellRectangle> merge_cells(sim::GridMask& mask);

/// Adds every face between an occupied voxel and a free one, merged per plane.
void append_exposed_faces(const VoxelBox& voxels, sim::TriangleMesh& mesh);

}  // namespace segsim::worlds
