#pragma once

/// @file
/// Boxes for the meshes of tests.

#include <array>
#include <cstdint>

#include "sim/ground/triangle_mesh.h"

namespace segsim::sim {

/// Adds the six sides of an axis-aligned box.
inline void append_box(TriangleMesh& mesh, const glm::vec3& min_m, const glm::vec3& max_m) {
  const auto base = static_cast<std::uint32_t>(mesh.positions_m.size());
  for (int corner = 0; corner < 8; ++corner) {
    mesh.positions_m.emplace_back((corner & 1) != 0 ? max_m.x : min_m.x,
                                  (corner & 2) != 0 ? max_m.y : min_m.y,
                                  (corner & 4) != 0 ? max_m.z : min_m.z);
  }
  // Corner bits: 1 = +x, 2 = +y, 4 = +z.
  constexpr std::array<std::array<std::uint32_t, 4>, 6> kSides = {{
      {0, 2, 3, 1},
      {4, 5, 7, 6},
      {0, 1, 5, 4},
      {2, 6, 7, 3},
      {0, 4, 6, 2},
      {1, 3, 7, 5},
  }};
  for (const auto& side : kSides) {
    mesh.triangles.emplace_back(base + side[0], base + side[1], base + side[2]);
    mesh.triangles.emplace_back(base + side[0], base + side[2], base + side[3]);
  }
}

}  // namespace segsim::sim
