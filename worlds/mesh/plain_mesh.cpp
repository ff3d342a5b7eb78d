#include "worlds/mesh/plain_mesh.h"

namespace segsim::worlds {

sim::TriangleMesh plain_mesh(const sim::MeshScene& scene) {
  sim::TriangleMesh mesh;
  for (const sim::SubMesh& part : scene.meshes) {
    const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
    mesh.positions_m.insert(mesh.positions_m.end(), part.positions_m.begin(),
                            part.positions_m.end());
    for (const glm::uvec3& t : part.triangles) mesh.triangles.push_back(t + first);
  }
  return mesh;
}

}  // namespace segsim::worlds
