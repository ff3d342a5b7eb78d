#pragma once

/// @file
/// A scene bundle as a world for Gazebo: the reconstructed collision mesh, and a Jackal on it.
///
///     DIR/world.sdf                     SDF 1.9: physics, place, robot
///     DIR/meshes/collision.obj          referred to by relative path: no search path needed
///     DIR/models/jackal/model.sdf, .config   the robot alone, for worlds of one's own
///
/// The robot has the size, mass and limits of RobotModel, differential drive, and the sensors
/// whose images sim/gazebo/gazebo_bridge.h serves:
///
///     jackal::base_link::front          rgbd_camera on "camera": camera/image, ...
///     jackal::base_link::front_labels   segmentation on "panoptic": panoptic/labels_map, ...
///     jackal::base_link::laser, imu, gps     Gazebo's own
///
/// Gazebo's Sensors system, which would draw the cameras a second time, is not loaded.

#include <filesystem>
#include <string>

#include "core/frames.h"
#include "core/scene_bundle.h"
#include "sim/gazebo/gazebo_bridge.h"
#include "sim/ground/robot.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::sim {

struct GazeboWorldOptions {
  RobotModel robot = RobotModel::jackal_gentle();
  core::Pose2 start;  ///< Of the robot.
  // Camera on the mast.
  double camera_height_m = 1.0, camera_pitch_down_rad = 0.0;
  int width_px = 640, height_px = 480;
  double horizontal_fov_rad = 1.2217304763960306;  ///< 70 degrees.
  double rate_hz = 30.0;
  double near_m = 0.05, far_m = 20.0;
  /// How plugins are named; kBoth is not possible.
  GazeboFlavour flavour = GazeboFlavour::kIgnition;
};

/// What names of worlds and topics may hold: letters, digits, '_'; others become '_'.
[[nodiscard]] std::string gazebo_world_name(const std::string& scene_name);

/// The text of world.sdf.
[[nodiscard]] std::string gazebo_world_sdf(const core::SceneManifest& scene,
                                           const GazeboWorldOptions& options);

/// Wavefront .obj with the same axes and units, for simulators.
/// @throws core::InputError if the file cannot be written or the mesh is empty.
void write_mesh_obj(const std::filesystem::path& file, const TriangleMesh& mesh);

/// The place on the floor where the robot has most room, heading along +x.
/// @throws core::InputError as World::load().
[[nodiscard]] core::Pose2 roomiest_start(const core::SceneBundle& bundle,
                                         const RobotModel& robot);

/// Writes all files; the last one is world.sdf.
/// @throws core::InputError: a broken bundle, a folder that cannot be written to.
void export_gazebo_world(const core::SceneBundle& bundle, const std::filesystem::path& folder,
                         const GazeboWorldOptions& options);

}  // namespace segsim::sim
