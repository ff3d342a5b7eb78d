#include "experiments/scenes/robot_room.h"

#include <string>

#include "core/error.h"
#include "core/formatted.h"
#include "core/version.h"
#include "sim/ground/free_disc.h"
#include "sim/ground/no_room.h"
#include "worlds/surface/bundle_files.h"

namespace segsim::experiments::scenes {
namespace {

bool has_room(const sim::TriangleMesh& mesh, const sim::RobotModel& robot) {
  try {
    static_cast<void>(sim::World::from_mesh(mesh, robot));
    return true;
  } catch (const core::InputError&) {
    return false;
  }
}

core::RenderingOnly without_room(const sim::TriangleMesh& mesh, const sim::RobotModel& robot,
                                 const std::string& reason) {
  const sim::NavmeshSettings agent = sim::navmesh_settings_for(robot);
  core::RenderingOnly only;
  only.reason = reason;
  only.robot = robot.name;
  only.free_disc = sim::largest_free_disc(mesh, agent.max_climb_m, agent.agent_height_m);
  for (const std::string& name : sim::RobotModel::names()) {
    if (name != robot.name && has_room(mesh, sim::RobotModel::by_name(name))) {
      only.fitting.push_back(name);
    }
  }
  return only;
}

}  // namespace

std::variant<sim::World, core::RenderingOnly> find_room(const sim::TriangleMesh& mesh,
                                                        const sim::RobotModel& robot) {
  try {
    return sim::World::from_mesh(mesh, robot);
  } catch (const sim::NoRoom&) {
    const sim::NavmeshSettings agent = sim::navmesh_settings_for(robot);
    return without_room(
        mesh, robot,
        core::print("no walkable area for %s (radius %.2f m, height %.2f m, steps of %.2f m)",
                    robot.name.c_str(), agent.agent_radius_m, agent.agent_height_m,
                    agent.max_climb_m));
  } catch (const core::InputError& error) {
    return without_room(mesh, robot, error.what());
  }
}

core::SceneBundle add_navmesh(const core::SceneBundle& bundle, const sim::RobotModel& robot) {
  const std::string place = bundle.folder.string();
  core::SceneManifest manifest = bundle.manifest;
  core::BundleParts parts = core::load_bundle_parts(bundle.folder);
  if (!parts.rendering_only) {
    throw core::InputError::expected(
        place, "a bundle for rendering and labels only",
        "one with a navigation mesh (another robot gets its own when it drives there)");
  }
  if (manifest.collision_mesh.name.empty()) {
    throw core::InputError::expected(
        place, "a collision mesh (`segsim scene remesh --floor-height` makes one)",
        "none: " + parts.rendering_only->reason);
  }
  const auto room = find_room(sim::read_mesh_ply(bundle.collision_mesh_file()), robot);
  if (const auto* none = std::get_if<core::RenderingOnly>(&room)) {
    throw core::InputError::expected(place, "room for " + robot.name, none->text());
  }
  parts.rendering_only.reset();
  manifest.created_by = std::string("segsim ") + core::version();
  worlds::write_navmesh(bundle.folder, std::get<sim::World>(room).navmesh(), manifest);
  core::write_bundle_manifest(bundle.folder, manifest, parts);
  return core::load_bundle(bundle.folder);
}

}  // namespace segsim::experiments::scenes
