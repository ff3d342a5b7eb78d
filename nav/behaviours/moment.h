#pragma once

/// @file
/// What every behaviour knows of the decision that is being made.

#include <glm/vec2.hpp>

#include "core/frames.h"
#include "core/stages.h"
#include "nav/grid/robot_pose.h"

namespace segsim::nav {

struct Moment {
  const core::Observation* observation = nullptr;  ///< Borrowed for the decision.
  core::Pose2 pose;                                ///< T_odom_robot, of the observation.
  glm::dvec2 position_m{0.0};                      ///< Its place, Odom.
  core::TimeNs time_ns = 0;
};

[[nodiscard]] inline Moment moment_of(const core::Observation& observation) {
  const core::Pose2 pose = pose_of(observation.T_odom_robot);
  return {&observation, pose, {pose.x_m, pose.y_m}, observation.capture_time_ns};
}

}  // namespace segsim::nav
