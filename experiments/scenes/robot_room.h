#pragma once

/// @file
/// Does a robot find room in a place? If not: why, how much room there is, and which robot
/// would.

#include <variant>

#include "core/bundle_parts.h"
#include "core/scene_bundle.h"
#include "sim/ground/robot.h"
#include "sim/ground/triangle_mesh.h"
#include "sim/ground/world.h"

namespace segsim::experiments::scenes {

/// The place made ready for the robot, or what its bundle says because it finds no room.
[[nodiscard]] std::variant<sim::World, core::RenderingOnly> find_room(
    const sim::TriangleMesh& collision_mesh, const sim::RobotModel& robot);

/// For a bundle for rendering and labels only that has a collision mesh: looks for the robot's
/// room in it. If there is some, navmesh.bin is written, then the manifest without the flag:
/// whoever stops in between leaves the bundle as it was.
/// @return  The bundle as it is now.
/// @throws core::InputError: a robot has room already, no collision mesh, no room for this one
/// either (the bundle is then unchanged).
core::SceneBundle add_navmesh(const core::SceneBundle& bundle, const sim::RobotModel& robot);

}  // namespace segsim::experiments::scenes
