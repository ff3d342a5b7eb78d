#pragma once

/// @file
/// Where the robot's own frame (Odom) lies in World at one moment. With perfect localisation
/// they are one; else what the robot believes has drifted, and its map is drawn where the
/// robot would arrive if it drove there now.

#include <cmath>

#include <glm/vec2.hpp>

#include "core/frames.h"

namespace segsim::experiments::drawing {

class OdomPlacement {
 public:
  /// Odom equals World.
  OdomPlacement() = default;
  /// @param truth  Of the robot in World. @param estimate  Of the robot in Odom, then.
  OdomPlacement(const core::Pose2& truth, const core::Pose2& estimate)
      : moved_(truth.x_m != estimate.x_m || truth.y_m != estimate.y_m ||
               truth.yaw_rad != estimate.yaw_rad),
        truth_m_(truth.x_m, truth.y_m),
        estimate_m_(estimate.x_m, estimate.y_m),
        cos_(std::cos(truth.yaw_rad - estimate.yaw_rad)),
        sin_(std::sin(truth.yaw_rad - estimate.yaw_rad)) {}

  [[nodiscard]] glm::dvec2 to_world(const glm::dvec2& p_odom_m) const {
    if (!moved_) return p_odom_m;
    const glm::dvec2 p_m = p_odom_m - estimate_m_;
    return truth_m_ + glm::dvec2(cos_ * p_m.x - sin_ * p_m.y, sin_ * p_m.x + cos_ * p_m.y);
  }
  [[nodiscard]] glm::dvec2 to_odom(const glm::dvec2& p_world_m) const {
    if (!moved_) return p_world_m;
    const glm::dvec2 p_m = p_world_m - truth_m_;
    return estimate_m_ + glm::dvec2(cos_ * p_m.x + sin_ * p_m.y, -sin_ * p_m.x + cos_ * p_m.y);
  }

 private:
  bool moved_ = false;
  glm::dvec2 truth_m_{0.0}, estimate_m_{0.0};
  double cos_ = 1.0, sin_ = 0.0;
};

}  // namespace segsim::experiments::drawing
