#pragma once

/// @file
/// Detour's own object behind a Navmesh and its axes, for other files of this module.

#include <array>

#include <glm/vec3.hpp>

class dtNavMesh;

namespace segsim::sim {
class Navmesh;
}

namespace segsim::sim::internal {

using Xyz = std::array<float, 3>;  ///< In Recast's and Detour's axes: y up.

inline Xyz to_y_up(const glm::dvec3& p) {
  return {static_cast<float>(p.x), static_cast<float>(p.z), static_cast<float>(-p.y)};
}
inline glm::dvec3 to_z_up(const float* p) { return {p[0], -p[2], p[1]}; }

struct NavmeshAccess {
  /// Valid as long as the navmesh.
  [[nodiscard]] static const dtNavMesh& mesh(const Navmesh& navmesh);
};

}  // namespace segsim::sim::internal
