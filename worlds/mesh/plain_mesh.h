#pragma once

#include "sim/ground/mesh_scene.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::worlds {

/// All triangles of a scene, without materials.
[[nodiscard]] sim::TriangleMesh plain_mesh(const sim::MeshScene& scene);

}  // namespace segsim::worlds
