#pragma once

/// @file
/// Plain indexed triangles for collision and navigation, without materials.

#include <filesystem>
#include <vector>

#include <glm/vec3.hpp>

namespace segsim::sim {

struct TriangleMesh {
  std::vector<glm::vec3> positions_m;  ///< World frame, z up.
  std::vector<glm::uvec3>
      triangles;  ///< Into `positions_m`; counter-clockwise seen from outside.
};

/// Adds a horizontal rectangle that faces up.
void append_floor(TriangleMesh& mesh, float x0_m, float y0_m, float x1_m, float y1_m,
                  float z_m = 0.0F);

/// Binary little-endian PLY: float x, y, z; faces as lists of three int.
void write_mesh_ply(const std::filesystem::path& file, const TriangleMesh& mesh);

/// Reads binary little-endian PLY whose first element is "vertex" with float or double x, y, z
/// (other scalar properties are skipped) and whose "face" element begins with a list of vertex
/// indices. Polygons are fanned.
/// @throws core::InputError: not such a PLY, cut short, an index out of range, a NaN position.
[[nodiscard]] TriangleMesh read_mesh_ply(const std::filesystem::path& file);

}  // namespace segsim::sim
