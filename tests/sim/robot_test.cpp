#include "sim/ground/robot.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/error.h"

namespace segsim::sim {
namespace {

/// No limit matters.
RobotModel unlimited() {
  RobotModel model = RobotModel::jackal();
  model.max_wheel_mps = 100.0;
  model.max_acceleration_mps2 = model.max_deceleration_mps2 = 1e9;
  model.max_turn_acceleration_radps2 = 1e9;
  return model;
}

TEST(DriveArc, QuarterCircle) {
  const core::Pose2 end = drive_arc({}, {1.0, std::numbers::pi / 2}, 1.0);
  EXPECT_NEAR(end.x_m, 0.636620, 1e-6);
  EXPECT_NEAR(end.y_m, 0.636620, 1e-6);
  EXPECT_NEAR(end.yaw_rad, std::numbers::pi / 2, 1e-12);
}

TEST(DriveArc, SmallTurnRateAgreesWithStraightLine) {
  const core::Pose2 straight = drive_arc({1, 2, 0.3}, {0.7, 0.0}, 2.0);
  const core::Pose2 bent = drive_arc({1, 2, 0.3}, {0.7, 2e-9}, 2.0);
  EXPECT_NEAR(straight.x_m, bent.x_m, 1e-6);
  EXPECT_NEAR(straight.y_m, bent.y_m, 1e-6);
}

TEST(Robot, ManySubstepsFollowTheSameCircle) {
  Robot robot(unlimited(), {});
  for (int k = 0; k < 200; ++k) robot.step({1.0, std::numbers::pi / 2}, 0.005);
  EXPECT_NEAR(robot.state().pose.x_m, 0.636620, 1e-6);
  EXPECT_NEAR(robot.state().pose.y_m, 0.636620, 1e-6);
}

TEST(Robot, AccelerationLimitsHold) {
  Robot robot(RobotModel::jackal_gentle(), {});
  robot.step({0.8, 0.0}, 0.1);
  EXPECT_NEAR(robot.state().forward_mps, 0.2, 1e-12);
  for (int k = 0; k < 10; ++k) robot.step({0.8, 0.0}, 0.1);
  EXPECT_NEAR(robot.state().forward_mps, 0.8, 1e-12);
  robot.step({5.0, 0.0}, 0.1);
  EXPECT_NEAR(robot.state().forward_mps, 0.8, 1e-12);
}

TEST(Robot, StopsWithinItsStoppingDistance) {
  const RobotModel model = RobotModel::jackal_gentle();
  Robot robot(model, {});
  robot.set_velocity({model.max_forward_mps, 0.0});
  for (int k = 0; k < 200; ++k) robot.step({0.0, 0.0}, 0.005);
  EXPECT_DOUBLE_EQ(robot.state().forward_mps, 0.0);
  EXPECT_NEAR(model.stopping_distance_m(), 0.16, 1e-12);
  EXPECT_LE(robot.state().pose.x_m, model.stopping_distance_m());
  EXPECT_GT(robot.state().pose.x_m, model.stopping_distance_m() - 0.8 * 0.005);
}

TEST(Robot, WheelSaturationKeepsCurvature) {
  RobotModel model = RobotModel::jackal();
  model.max_acceleration_mps2 = 1e9;
  model.max_turn_acceleration_radps2 = 1e9;
  Robot robot(model, {});
  const core::VelocityCommand v = [&] {
    robot.set_command({2.0, 3.0});
    return robot.update_velocity(0.01);
  }();
  EXPECT_NEAR(v.forward_mps / v.turn_radps, 2.0 / 3.0, 1e-12);
  const double half_track = 0.5 * 0.37559 * 1.5;
  EXPECT_NEAR(v.forward_mps + v.turn_radps * half_track, model.max_wheel_mps, 1e-12);
}

TEST(Robot, BrakesWhenCommandsStop) {
  RobotModel model = unlimited();
  Robot robot(model, {});
  robot.set_command({1.0, 0.5});
  // Timeout 0.25 s = 50 substeps, in which the command holds.
  for (int k = 0; k < 50; ++k) robot.step(0.005);
  EXPECT_DOUBLE_EQ(robot.state().forward_mps, 1.0);
  robot.step(0.005);
  EXPECT_DOUBLE_EQ(robot.state().forward_mps, 0.0);
  EXPECT_DOUBLE_EQ(robot.state().turn_radps, 0.0);
}

TEST(RobotModel, JackalMeasures) {
  const RobotModel model = RobotModel::by_name("jackal");
  EXPECT_NEAR(model.circumscribed_radius_m(), 0.333, 5e-4);
  EXPECT_NEAR(model.inscribed_radius_m(), 0.215, 1e-12);
  EXPECT_THROW(RobotModel::by_name("jackel"), core::InputError);
}

/// Whoever adds a profile gets this test with it.
TEST(RobotModel, EveryProfileIsWhole) {
  EXPECT_GE(RobotModel::names().size(), 4U);
  for (const std::string& name : RobotModel::names()) {
    SCOPED_TRACE(name);
    const RobotModel model = RobotModel::by_name(name);
    EXPECT_EQ(model.name, name);
    EXPECT_GT(model.inscribed_radius_m(), 0.1);
    EXPECT_GT(model.stopping_distance_m(), 0.0);
    EXPECT_GE(model.max_wheel_mps, model.max_forward_mps)
        << "full speed ahead must be possible";
    EXPECT_LT(model.track_m, model.width_m);
    EXPECT_GT(model.mast_height_m, model.body_top_m);
    // Full speed within a second, a full stop within its stopping distance.
    Robot robot(model, {});
    for (int k = 0; k < 200; ++k) robot.step({10.0, 0.0}, 0.005);
    EXPECT_NEAR(robot.state().forward_mps, model.max_forward_mps, 1e-9);
    const double from_m = robot.state().pose.x_m;
    for (int k = 0; k < 400; ++k) robot.step({0.0, 0.0}, 0.005);
    EXPECT_LE(robot.state().pose.x_m - from_m, model.stopping_distance_m());
  }
}

}  // namespace
}  // namespace segsim::sim
