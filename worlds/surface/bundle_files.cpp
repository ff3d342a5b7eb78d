#include "worlds/surface/bundle_files.h"

#include "sim/ground/navmesh.h"
#include "sim/ground/world.h"

namespace segsim::worlds {

void write_collision_files(const std::filesystem::path& folder, const sim::TriangleMesh& mesh,
                           const sim::RobotModel& robot, core::SceneManifest& manifest) {
  const sim::Navmesh navmesh = sim::Navmesh::build(mesh, sim::navmesh_settings_for(robot));
  manifest.collision_mesh.name = "collision.ply";
  manifest.navmesh.name = "navmesh.bin";
  manifest.robot_radius_m = robot.circumscribed_radius_m();
  manifest.robot_height_m = navmesh.settings().agent_height_m;
  sim::write_mesh_ply(folder / manifest.collision_mesh.name, mesh);
  navmesh.save(folder / manifest.navmesh.name);
  manifest.statistics.emplace_back("navmesh_polygons", navmesh.polygon_count());
  manifest.statistics.emplace_back("navmesh_islands",
                                   static_cast<double>(navmesh.island_areas_m2().size()));
  manifest.statistics.emplace_back("navmesh_largest_m2", navmesh.island_areas_m2().front());
}

namespace {

CollisionMeshResult written(const std::filesystem::path& folder, CollisionMeshResult result,
                            const sim::RobotModel& robot, core::SceneManifest& manifest) {
  for (const auto& statistic : result.statistics()) manifest.statistics.push_back(statistic);
  write_collision_files(folder, result.mesh, robot, manifest);
  return result;
}

}  // namespace

CollisionMeshResult write_collision_files(const std::filesystem::path& folder,
                                          std::span<const glm::vec3> points_m,
                                          std::span<const glm::vec3> normals,
                                          std::span<const glm::dvec3> camera_positions_m,
                                          const sim::RobotModel& robot,
                                          const CollisionMeshOptions& options,
                                          core::SceneManifest& manifest) {
  return written(folder, make_collision_mesh(points_m, normals, camera_positions_m, options),
                 robot, manifest);
}

CollisionMeshResult write_collision_files(const std::filesystem::path& folder,
                                          const sim::TriangleMesh& surface,
                                          std::span<const glm::dvec3> camera_positions_m,
                                          const sim::RobotModel& robot,
                                          const CollisionMeshOptions& options,
                                          core::SceneManifest& manifest) {
  return written(folder, collision_mesh_of_surface(surface, camera_positions_m, options),
                 robot, manifest);
}

}  // namespace segsim::worlds
