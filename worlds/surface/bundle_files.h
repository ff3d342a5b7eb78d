#pragma once

/// @file
/// The part of a scene bundle that this module writes: collision.ply and navmesh.bin.

#include <filesystem>

#include "core/scene_bundle.h"
#include "sim/ground/navmesh.h"
#include "sim/ground/robot.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::worlds {

/// Writes collision.ply and names it in the manifest.
void write_collision_mesh(const std::filesystem::path& folder, const sim::TriangleMesh& mesh,
                          core::SceneManifest& manifest);

/// Writes navmesh.bin and fills the fields of the manifest that describe it: file name, robot
/// radius and height, statistics (appended).
void write_navmesh(const std::filesystem::path& folder, const sim::Navmesh& navmesh,
                   core::SceneManifest& manifest);

/// Both, of a mesh.
/// @throws core::InputError if the mesh has no room for the robot.
void write_collision_files(const std::filesystem::path& folder, const sim::TriangleMesh& mesh,
                           const sim::RobotModel& robot, core::SceneManifest& manifest);

}  // namespace segsim::worlds
