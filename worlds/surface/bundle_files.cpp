#include "worlds/surface/bundle_files.h"

#include "sim/ground/world.h"

namespace segsim::worlds {

void write_collision_mesh(const std::filesystem::path& folder, const sim::TriangleMesh& mesh,
                          core::SceneManifest& manifest) {
  manifest.collision_mesh.name = "collision.ply";
  sim::write_mesh_ply(folder / manifest.collision_mesh.name, mesh);
}

void write_navmesh(const std::filesystem::path& folder, const sim::Navmesh& navmesh,
                   core::SceneManifest& manifest) {
  manifest.navmesh.name = "navmesh.bin";
  manifest.robot_radius_m = navmesh.settings().agent_radius_m;
  manifest.robot_height_m = navmesh.settings().agent_height_m;
  navmesh.save(folder / manifest.navmesh.name);
  manifest.statistics.emplace_back("navmesh_polygons", navmesh.polygon_count());
  manifest.statistics.emplace_back("navmesh_islands",
                                   static_cast<double>(navmesh.island_areas_m2().size()));
  manifest.statistics.emplace_back("navmesh_largest_m2", navmesh.island_areas_m2().front());
}

void write_collision_files(const std::filesystem::path& folder, const sim::TriangleMesh& mesh,
                           const sim::RobotModel& robot, core::SceneManifest& manifest) {
  const sim::Navmesh navmesh = sim::Navmesh::build(mesh, sim::navmesh_settings_for(robot));
  write_collision_mesh(folder, mesh, manifest);
  write_navmesh(folder, navmesh, manifest);
}

}  // namespace segsim::worlds
