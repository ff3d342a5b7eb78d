#include "sim/ground/world.h"

#include <algorithm>
#include <string>
#include <utility>

#include "core/bundle_parts.h"
#include "core/error.h"
#include "sim/ground/no_room.h"

namespace segsim::sim {

NavmeshSettings navmesh_settings_for(const RobotModel& robot) {
  NavmeshSettings settings;
  settings.agent_radius_m = robot.circumscribed_radius_m();
  settings.agent_height_m = std::max({robot.height_m, robot.body_top_m, robot.mast_height_m});
  settings.max_climb_m = robot.clearance_m;
  return settings;
}

World::World(TriangleMesh mesh, const RobotModel& robot, Navmesh navmesh,
             const core::GeodeticOrigin& origin)
    : mesh_(std::move(mesh)),
      robot_(robot),
      collision_(std::make_unique<const CollisionWorld>(mesh_, robot)),
      free_space_(std::make_unique<const FreeSpace>(make_free_space(*collision_))),
      navmesh_(std::make_unique<const Navmesh>(std::move(navmesh))),
      local_frame_(origin) {
  if (free_space_->area_m2() <= 0.0) {
    throw NoRoom(
        core::InputError::expected("scene", "room for " + robot.name, "no free place"));
  }
}

World World::load(const core::SceneBundle& bundle, const RobotModel& robot) {
  core::require_drivable(bundle);
  TriangleMesh mesh = read_mesh_ply(bundle.collision_mesh_file());
  Navmesh navmesh = Navmesh::load(bundle.navmesh_file());
  // The file is for the robot it was made for; another one gets a mesh of its own.
  if (navmesh.settings() != navmesh_settings_for(robot)) {
    navmesh = Navmesh::build(mesh, navmesh_settings_for(robot));
  }
  World world(std::move(mesh), robot, std::move(navmesh), bundle.manifest.origin);
  world.manifest_ = bundle.manifest;
  return world;
}

World World::from_mesh(TriangleMesh mesh, const RobotModel& robot,
                       const core::GeodeticOrigin& origin) {
  Navmesh navmesh = Navmesh::build(mesh, navmesh_settings_for(robot));
  return {std::move(mesh), robot, std::move(navmesh), origin};
}

}  // namespace segsim::sim
