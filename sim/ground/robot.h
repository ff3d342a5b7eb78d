#pragma once

/// @file
/// A differential-drive base: limits, footprint, and exact motion along circular arcs.
///
/// Robots are YAML files: those of sim/robots/ are built in, others are given by their path.
///
/// Order within one step: command limits -> acceleration limits
/// -> wheel saturation (curvature is kept) -> exact arc
///
///     x += v/w (sin(yaw + w h) - sin yaw),  y -= v/w (cos(yaw + w h) - cos yaw)

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/config.h"
#include "core/frames.h"
#include "core/robot_base.h"
#include "core/stages.h"

namespace segsim::sim {

/// One kind of robot: its shape and limits, which a planner may know, and its drive.
struct RobotModel : core::RobotBase {
  /// Unique: of a robot from a file "<its name>@<first digits of the file's SHA-256>".
  std::string name;
  std::string title;             ///< One line for people.
  std::string file;              ///< Where it comes from; empty: it is built in.
  double height_m = 0.0;         ///< Of the base, without load and mast.
  double camera_height_m = 1.2;  ///< Of its camera, where a scene does not say otherwise.
  // Wheels.
  double max_wheel_mps = 0.0;  ///< Rim speed.
  double wheel_radius_m = 0.0;
  double track_m = 0.0;  ///< Between wheel centres.
  double separation_multiplier =
      1.0;                          ///< Skid steering: effective track = track * multiplier.
  double command_timeout_s = 0.25;  ///< Without a new command for so long the base brakes.

  /// Names of the built-in robots, the files of sim/robots/.
  [[nodiscard]] static const std::vector<std::string>& names();
  /// A built-in robot, or that of a file: anything with a slash or that ends in ".yaml".
  /// @throws core::InputError that names all built-in ones, or what is wrong with the file.
  [[nodiscard]] static RobotModel by_name(const std::string& name_or_file);
  /// The same for a text of a spec. @param expand  Its path, with the variables replaced.
  /// @throws core::InputError with file, line and key.
  [[nodiscard]] static RobotModel read(
      const core::ConfigNode& node,
      const std::function<std::filesystem::path(const core::ConfigNode&)>& expand);
  /// @throws core::InputError with file, line and key.
  [[nodiscard]] static RobotModel load(const std::filesystem::path& file);
  /// The two that most tests drive.
  [[nodiscard]] static RobotModel jackal() { return by_name("jackal"); }
  [[nodiscard]] static RobotModel jackal_gentle() { return by_name("jackal-gentle"); }
};

struct RobotState {
  core::Pose2 pose;
  double forward_mps = 0.0, turn_radps = 0.0;
};

/// Pose after driving with constant (v, w) for `duration_s`.
[[nodiscard]] core::Pose2 drive_arc(const core::Pose2& pose,
                                    const core::VelocityCommand& velocity, double duration_s);

/// The base without a world: collision is decided by whoever moves it
/// (sim/ground/collision.h).
class Robot {
 public:
  Robot(const RobotModel& model, const core::Pose2& pose);

  /// Takes effect with the next step and holds until the command timeout.
  void set_command(const core::VelocityCommand& command);
  /// Velocities that hold during the coming `duration_s`, after all limits. Advances the
  /// command's age, not the pose.
  core::VelocityCommand update_velocity(double duration_s);
  /// `update_velocity`, then the arc, on free ground.
  void step(double duration_s);
  void step(const core::VelocityCommand& command, double duration_s) {
    set_command(command);
    step(duration_s);
  }

  [[nodiscard]] const RobotState& state() const { return state_; }
  [[nodiscard]] const RobotModel& model() const { return model_; }
  void set_pose(const core::Pose2& pose) { state_.pose = pose; }
  /// After an impact.
  void set_velocity(const core::VelocityCommand& velocity);

 private:
  RobotModel model_;
  RobotState state_;
  core::VelocityCommand command_;
  double command_age_s_ = 0.0;
};

}  // namespace segsim::sim
