#pragma once

#include <cmath>

#include "core/frames.h"
#include "core/stages.h"

namespace segsim::nav {

/// Where the robot stands and looks on the floor plane; what it leans by is left out.
[[nodiscard]] inline core::Pose2 pose_of(
    const core::Transform<core::frame::Odom, core::frame::Robot>& T_odom_robot) {
  const glm::dquat& q = T_odom_robot.rotation();
  const glm::dvec3& p = T_odom_robot.translation_m();
  return {p.x, p.y,
          std::atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))};
}

/// Without a pose nothing can be mapped and no way is known.
[[nodiscard]] inline bool finite_pose(const core::Observation& observation) {
  const glm::dvec3& p = observation.T_odom_robot.translation_m();
  const glm::dquat& q = observation.T_odom_robot.rotation();
  return std::isfinite(p.x + p.y + p.z + q.w + q.x + q.y + q.z);
}

}  // namespace segsim::nav
