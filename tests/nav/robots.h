#pragma once

/// @file
/// Robots to plan for; RobotFit.TheTestsJackalIsTheSimulators keeps the first one honest.

#include "core/robot_base.h"

namespace segsim::nav::test {

/// The Jackal with limits for indoors.
inline core::RobotBase jackal() {
  core::RobotBase robot;
  robot.length_m = 0.508;
  robot.width_m = 0.430;
  robot.max_forward_mps = 0.8;
  robot.max_turn_radps = 1.57;
  robot.max_acceleration_mps2 = robot.max_deceleration_mps2 = 2.0;
  robot.max_turn_acceleration_radps2 = 4.0;
  return robot;
}

/// Little more than half as wide.
inline core::RobotBase small_robot() {
  core::RobotBase robot = jackal();
  robot.length_m = 0.28;
  robot.width_m = 0.24;
  return robot;
}

}  // namespace segsim::nav::test
