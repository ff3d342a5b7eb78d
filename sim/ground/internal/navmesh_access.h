#pragma once

/// @file
/// Detour's own object behind a Navmesh, for other files of this module.

class dtNavMesh;

namespace segsim::sim {
class Navmesh;
}

namespace segsim::sim::internal {

struct NavmeshAccess {
  /// Valid as long as the navmesh.
  [[nodiscard]] static const dtNavMesh& mesh(const Navmesh& navmesh);
};

}  // namespace segsim::sim::internal
