#pragma once

/// @file
/// What a planner may know of the robot that it plans for: how much room it takes, and how it
/// can move. The simulator's robot (sim/ground/robot.h) is made of the same two parts.

#include <algorithm>
#include <cmath>

namespace segsim::core {

/// A rectangle that drives, with a thin camera mast on it. The robot's origin is the centre of
/// the rectangle, on the floor.
struct RobotShape {
  double length_m = 0.0, width_m = 0.0;  ///< Along x and along y.
  double body_top_m = 0.60;     ///< Obstacles up to here meet the rectangle (load, sensors).
  double clearance_m = 0.06;    ///< What is lower is driven over.
  double mast_height_m = 1.25;  ///< Top of the mast, a cylinder at the origin; 0: no mast.
  double mast_radius_m = 0.05;

  /// Half the diagonal: a disc that holds the rectangle at every heading.
  [[nodiscard]] double circumscribed_radius_m() const {
    return 0.5 * std::hypot(length_m, width_m);
  }
  /// Half the shorter side.
  [[nodiscard]] double inscribed_radius_m() const { return 0.5 * std::min(length_m, width_m); }
};

/// Limits of a differential drive.
struct DriveLimits {
  double max_forward_mps = 0.0, max_turn_radps = 0.0;
  double max_acceleration_mps2 = 0.0, max_deceleration_mps2 = 0.0;
  double max_turn_acceleration_radps2 = 0.0;
};

/// Both.
struct RobotBase : RobotShape, DriveLimits {};

}  // namespace segsim::core
