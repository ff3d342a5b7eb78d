#pragma once

/// @file
/// One place, made ready for one robot: immutable, shared by all trials in it.

#include <filesystem>
#include <memory>
#include <span>

#include <glm/vec2.hpp>

#include "core/scene_bundle.h"
#include "sim/ground/collision.h"
#include "sim/ground/distance_field.h"
#include "sim/ground/geodesy.h"
#include "sim/ground/navmesh.h"
#include "sim/ground/robot.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::sim {

class World {
 public:
  /// @throws core::InputError: a broken file, no floor; a bundle for rendering and labels
  /// only.
  /// @throws NoRoom (sim/ground/no_room.h) for this robot.
  [[nodiscard]] static World load(const core::SceneBundle& bundle, const RobotModel& robot);
  /// Builds everything from a mesh in memory.
  [[nodiscard]] static World from_mesh(TriangleMesh mesh, const RobotModel& robot,
                                       const core::GeodeticOrigin& origin = {});

  /// Valid as long as this world.
  [[nodiscard]] DistanceField distance_to(std::span<const glm::dvec2> goals_m) const {
    return {*free_space_, goals_m};
  }

  [[nodiscard]] const TriangleMesh& mesh() const { return mesh_; }
  [[nodiscard]] const CollisionWorld& collision() const { return *collision_; }
  [[nodiscard]] const FreeSpace& free_space() const { return *free_space_; }
  [[nodiscard]] const Navmesh& navmesh() const { return *navmesh_; }
  [[nodiscard]] const LocalFrame& local_frame() const { return local_frame_; }
  [[nodiscard]] const RobotModel& robot() const { return robot_; }
  /// Names of classes and instances; empty for a world from a mesh.
  [[nodiscard]] const core::SceneManifest& manifest() const { return manifest_; }
  /// For a world from a mesh in memory: class ids give goal pixels their meaning.
  void set_manifest(core::SceneManifest manifest) { manifest_ = std::move(manifest); }

 private:
  World(TriangleMesh mesh, const RobotModel& robot, Navmesh navmesh,
        const core::GeodeticOrigin& origin);

  TriangleMesh mesh_;
  RobotModel robot_;
  // Behind pointers so that a World can move while fields refer to them.
  std::unique_ptr<const CollisionWorld> collision_;
  std::unique_ptr<const FreeSpace> free_space_;
  std::unique_ptr<const Navmesh> navmesh_;
  LocalFrame local_frame_;
  core::SceneManifest manifest_;
};

/// Settings of the navmesh that belongs to a robot.
[[nodiscard]] NavmeshSettings navmesh_settings_for(const RobotModel& robot);

}  // namespace segsim::sim
