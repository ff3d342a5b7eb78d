#include "sim/ground/robot.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"

namespace segsim::sim {
namespace {

/// Below this turn rate an arc is a straight line to within rounding.
constexpr double kStraight_radps = 1e-9;

}  // namespace

core::Pose2 drive_arc(const core::Pose2& pose, const core::VelocityCommand& velocity,
                      double duration_s) {
  const double v = velocity.forward_mps;
  const double w = velocity.turn_radps;
  core::Pose2 end = pose;
  if (std::abs(w) < kStraight_radps) {
    end.x_m += v * duration_s * std::cos(pose.yaw_rad);
    end.y_m += v * duration_s * std::sin(pose.yaw_rad);
    return end;
  }
  const double yaw = pose.yaw_rad + w * duration_s;
  end.x_m += v / w * (std::sin(yaw) - std::sin(pose.yaw_rad));
  end.y_m -= v / w * (std::cos(yaw) - std::cos(pose.yaw_rad));
  end.yaw_rad = core::wrap_angle_rad(yaw);
  return end;
}

Robot::Robot(const RobotModel& model, const core::Pose2& pose) : model_(model) {
  SEGSIM_CHECK(model.max_forward_mps > 0.0 && model.max_wheel_mps > 0.0, model.name);
  state_.pose = pose;
}

void Robot::set_command(const core::VelocityCommand& command) {
  SEGSIM_CHECK(std::isfinite(command.forward_mps) && std::isfinite(command.turn_radps),
               "command is not a number");
  command_ = command;
  command_age_s_ = 0.0;
}

void Robot::set_velocity(const core::VelocityCommand& velocity) {
  state_.forward_mps = velocity.forward_mps;
  state_.turn_radps = velocity.turn_radps;
}

core::VelocityCommand Robot::update_velocity(double duration_s) {
  SEGSIM_CHECK(duration_s > 0.0, "step without duration");
  core::VelocityCommand wanted = command_;
  // The small term keeps a timeout of n whole steps from depending on how n sums round.
  if (command_age_s_ > model_.command_timeout_s - 1e-9) wanted = {};
  command_age_s_ += duration_s;
  wanted.forward_mps =
      std::clamp(wanted.forward_mps, -model_.max_forward_mps, model_.max_forward_mps);
  wanted.turn_radps =
      std::clamp(wanted.turn_radps, -model_.max_turn_radps, model_.max_turn_radps);

  // Braking is what brings |v| down without a change of sign.
  const double v = state_.forward_mps;
  const bool braking =
      std::abs(wanted.forward_mps) < std::abs(v) && wanted.forward_mps * v >= 0.0;
  const double dv_max =
      (braking ? model_.max_deceleration_mps2 : model_.max_acceleration_mps2) * duration_s;
  const double dw_max = model_.max_turn_acceleration_radps2 * duration_s;
  double forward = v + std::clamp(wanted.forward_mps - v, -dv_max, dv_max);
  double turn =
      state_.turn_radps + std::clamp(wanted.turn_radps - state_.turn_radps, -dw_max, dw_max);

  // The faster side decides, and both are slowed alike, so the arc keeps its radius.
  const double half_track = 0.5 * model_.track_m * model_.separation_multiplier;
  const double fastest = std::abs(forward) + std::abs(turn) * half_track;
  if (fastest > model_.max_wheel_mps) {
    forward *= model_.max_wheel_mps / fastest;
    turn *= model_.max_wheel_mps / fastest;
  }
  state_.forward_mps = forward;
  state_.turn_radps = turn;
  return {forward, turn};
}

void Robot::step(double duration_s) {
  const core::VelocityCommand velocity = update_velocity(duration_s);
  state_.pose = drive_arc(state_.pose, velocity, duration_s);
}

}  // namespace segsim::sim
