#pragma once

/// @file
/// The distances that maps and planners keep, from the robot's shape. The shares and the extra
/// centimetres were found for the Jackal (0.508 m x 0.430 m) and are kept for all robots; with
/// r for the inscribed and R for the circumscribed radius:
///
///     planned with          R, to the centimetre                          Jackal: 0.33 m
///     where that is closed  r + 0.55 (R - r), to the centimetre                   0.28 m
///     at last               r + 0.02 m                                            0.235 m
///     driven with           a centimetre less than where that is closed           0.27 m
///     surely free           0.65 of the planned one, at most r                    0.2145 m
///     off the mast          its radius + 0.05 m, a cell                           0.10 m
///     obstacles are         from clearance + 0.04 m up to the body's top   0.10 .. 0.60 m

#include "core/robot_base.h"

namespace segsim::nav {

struct RobotFit {
  double radius_m = 0.0;            ///< The planner keeps this off obstacles.
  double tight_radius_m = 0.0;      ///< ... where the full one leaves no way,
  double narrow_radius_m = 0.0;     ///< ... and where that one leaves none.
  double footprint_radius_m = 0.0;  ///< Circle that the follower keeps free.
  double inside_radius_m = 0.0;     ///< Where the robot stands nothing else does.
  double mast_radius_m = 0.0;
  double obstacle_min_m = 0.0, obstacle_max_m = 0.0;  ///< Heights that the body can hit.
};

/// @throws ContractViolation for a shape without size.
[[nodiscard]] RobotFit fit_of(const core::RobotShape& shape);

}  // namespace segsim::nav
