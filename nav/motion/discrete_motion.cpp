#include "nav/motion/discrete_motion.h"

#include <algorithm>
#include <cmath>

namespace segsim::nav {

DiscreteAction action_towards(const core::Pose2& pose, const glm::dvec2& place_m,
                              const DiscreteMotionOptions& options) {
  const double bearing = std::atan2(place_m.y - pose.y_m, place_m.x - pose.x_m);
  const double error = core::wrap_angle_rad(bearing - pose.yaw_rad);
  if (std::abs(error) <= options.turn_above_rad) return DiscreteAction::kForward;
  return error > 0.0 ? DiscreteAction::kTurnLeft : DiscreteAction::kTurnRight;
}

core::Pose2 after_action(const core::Pose2& pose, DiscreteAction action,
                         const DiscreteMotionOptions& options) {
  core::Pose2 to = pose;
  switch (action) {
    case DiscreteAction::kForward:
      to.x_m += options.forward_m * std::cos(pose.yaw_rad);
      to.y_m += options.forward_m * std::sin(pose.yaw_rad);
      break;
    case DiscreteAction::kTurnLeft:
      to.yaw_rad = core::wrap_angle_rad(pose.yaw_rad + options.turn_rad);
      break;
    case DiscreteAction::kTurnRight:
      to.yaw_rad = core::wrap_angle_rad(pose.yaw_rad - options.turn_rad);
      break;
    case DiscreteAction::kStop:
      break;
  }
  return to;
}

void DiscreteExecutor::start(DiscreteAction action, const core::Pose2& pose,
                             core::TimeNs time_ns) {
  timed_out_ = false;
  action_.reset();
  if (action == DiscreteAction::kStop) return;
  action_ = action;
  from_ = pose;
  to_ = after_action(pose, action, options_);
  since_ns_ = time_ns;
}

core::VelocityCommand DiscreteExecutor::command(const core::Pose2& pose, core::TimeNs time_ns,
                                                double period_s) {
  if (!action_) return {};
  if (core::seconds(time_ns - since_ns_) > options_.timeout_s) {
    timed_out_ = true;
    action_.reset();
    return {};
  }
  const double period = std::max(period_s, 1e-3);
  if (*action_ == DiscreteAction::kForward) {
    const double left_m = (to_.x_m - pose.x_m) * std::cos(from_.yaw_rad) +
                          (to_.y_m - pose.y_m) * std::sin(from_.yaw_rad);
    if (left_m > options_.forward_tolerance_m) {
      // Held to the heading, which a skid-steered base does not keep by itself.
      const double drift = core::wrap_angle_rad(from_.yaw_rad - pose.yaw_rad);
      return {std::min(left_m / period, options_.max_forward_mps),
              std::clamp(drift, -options_.max_turn_radps, options_.max_turn_radps)};
    }
  } else {
    const double left = core::wrap_angle_rad(to_.yaw_rad - pose.yaw_rad);
    const bool forwards = (*action_ == DiscreteAction::kTurnLeft) == (left > 0.0);
    if (forwards && std::abs(left) > options_.turn_tolerance_rad) {
      return {0.0,
              std::copysign(std::min(std::abs(left) / period, options_.max_turn_radps), left)};
    }
  }
  action_.reset();
  return {};
}

}  // namespace segsim::nav
