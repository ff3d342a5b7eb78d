#pragma once

/// @file
/// A differential-drive base: limits, footprint, and exact motion along circular arcs.
///
/// The numbers of the Jackal profile are from the public jackal repository
/// (jackal_control/config/control.yaml, jackal_description/urdf/jackal.urdf.xacro). Order
/// within one step: command limits -> acceleration limits -> wheel saturation (curvature is
/// kept) -> exact arc
///
///     x += v/w (sin(yaw + w h) - sin yaw),  y -= v/w (cos(yaw + w h) - cos yaw)

#include <string>
#include <vector>

#include "core/frames.h"
#include "core/stages.h"

namespace segsim::sim {

struct RobotModel {
  std::string name;
  // Outer size of the base; the origin is its centre.
  double length_m = 0.0, width_m = 0.0, height_m = 0.0;
  double body_top_m = 0.60;   ///< Obstacles up to here meet the footprint (load, sensors).
  double clearance_m = 0.06;  ///< What is lower is driven over.
  double mast_height_m =
      1.25;  ///< Top of the camera mast, a thin cylinder at the origin; 0 = no mast.
  double mast_radius_m = 0.05;
  // Limits.
  double max_forward_mps = 0.0, max_turn_radps = 0.0;
  double max_acceleration_mps2 = 0.0, max_deceleration_mps2 = 0.0;
  double max_turn_acceleration_radps2 = 0.0;
  double max_wheel_mps = 0.0;  ///< Rim speed.
  // Wheels.
  double wheel_radius_m = 0.0;
  double track_m = 0.0;  ///< Between wheel centres.
  double separation_multiplier =
      1.0;                          ///< Skid steering: effective track = track * multiplier.
  double command_timeout_s = 0.25;  ///< Without a new command for so long the base brakes.

  /// Half the diagonal of the footprint: a disc that holds the base at every heading.
  [[nodiscard]] double circumscribed_radius_m() const;
  /// Half the shorter side.
  [[nodiscard]] double inscribed_radius_m() const;
  /// v^2 / 2a from full speed.
  [[nodiscard]] double stopping_distance_m() const;

  /// Clearpath Jackal as its controller is configured (2 m/s, 20 m/s^2: hardly a limit).
  [[nodiscard]] static RobotModel jackal();
  /// The same base indoors: 0.8 m/s, 1.57 rad/s, 2 m/s^2, 4 rad/s^2.
  [[nodiscard]] static RobotModel jackal_gentle();
  /// TurtleBot3 Waffle Pi, from its maker's table of specifications: 0.26 m/s, 1.82 rad/s. The
  /// acceleration limits (1 m/s^2, 3 rad/s^2) and the mast at 0.6 m are ours.
  [[nodiscard]] static RobotModel turtlebot3_waffle();
  /// A square of 0.40 m with 0.6 m/s and 1.5 rad/s: no maker's, for comparisons.
  [[nodiscard]] static RobotModel generic_diff();
  /// "jackal", "jackal-gentle", "turtlebot3-waffle", "generic-diff".
  [[nodiscard]] static const std::vector<std::string>& names();
  /// @throws core::InputError naming all of them for any other name.
  [[nodiscard]] static RobotModel by_name(const std::string& name);
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
