#pragma once

/// @file
/// Gazebo's physics (ignition-physics with its DART engine) without Gazebo: an exported world
/// in which a Jackal is driven by its wheels.

#include <memory>
#include <string>

namespace segsim::tests {

/// A robot's place in the world [m], and its rotation as a quaternion.
struct BodyPose {
  double x_m = 0.0, y_m = 0.0, z_m = 0.0;
  double qw = 1.0, qx = 0.0, qy = 0.0, qz = 0.0;
};

class DartWorld {
 public:
  static constexpr double kStep_s = 1.0 / 240.0;

  /// @param sdf_file  Of `segsim gazebo export-world`.
  /// @throws std::runtime_error with what is missing.
  explicit DartWorld(const std::string& sdf_file);
  ~DartWorld();

  /// Sets the robot down, at rest.
  void set_pose(double x_m, double y_m, double z_m, double yaw_rad);
  /// One step of time. The wheels follow as Gazebo's DiffDrive has it, with the limits of
  /// acceleration of the world's file.
  void step(double forward_mps, double turn_radps);
  /// Of the model's frame.
  [[nodiscard]] BodyPose pose() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace segsim::tests
