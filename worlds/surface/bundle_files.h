#pragma once

/// @file
/// The part of a scene bundle that this module writes: collision.ply and navmesh.bin.

#include <filesystem>
#include <span>

#include <glm/vec3.hpp>

#include "core/scene_bundle.h"
#include "sim/ground/robot.h"
#include "worlds/surface/collision_mesh.h"

namespace segsim::worlds {

/// Makes both files in `folder` from reconstructed points and fills the fields of `manifest`
/// that describe them: file names, robot radius and height, statistics (appended).
/// @throws core::InputError if the points leave no floor or no room for the robot.
CollisionMeshResult write_collision_files(const std::filesystem::path& folder,
                                          std::span<const glm::vec3> points_m,
                                          std::span<const glm::vec3> normals,
                                          std::span<const glm::dvec3> camera_positions_m,
                                          const sim::RobotModel& robot,
                                          const CollisionMeshOptions& options,
                                          core::SceneManifest& manifest);

/// The same from a fused surface (worlds/surface/depth_fusion.h).
CollisionMeshResult write_collision_files(const std::filesystem::path& folder,
                                          const sim::TriangleMesh& surface,
                                          std::span<const glm::dvec3> camera_positions_m,
                                          const sim::RobotModel& robot,
                                          const CollisionMeshOptions& options,
                                          core::SceneManifest& manifest);

/// The same from a mesh that exists already, for example a simulator's own.
void write_collision_files(const std::filesystem::path& folder, const sim::TriangleMesh& mesh,
                           const sim::RobotModel& robot, core::SceneManifest& manifest);

}  // namespace segsim::worlds
