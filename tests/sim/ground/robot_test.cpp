#include "sim/ground/robot.h"

#include <cmath>
#include <numbers>

#include <filesystem>
#include <ostream>

#include <gmock/gmock.h>

#include "core/error.h"
#include "core/file_io.h"

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

/// v^2 / 2a from full speed.
double stopping_distance_m(const RobotModel& model) {
  return model.max_forward_mps * model.max_forward_mps / (2.0 * model.max_deceleration_mps2);
}

TEST(Robot, StopsWithinItsStoppingDistance) {
  const RobotModel model = RobotModel::jackal_gentle();
  Robot robot(model, {});
  robot.set_velocity({model.max_forward_mps, 0.0});
  for (int k = 0; k < 200; ++k) robot.step({0.0, 0.0}, 0.005);
  EXPECT_DOUBLE_EQ(robot.state().forward_mps, 0.0);
  EXPECT_NEAR(stopping_distance_m(model), 0.16, 1e-12);
  EXPECT_LE(robot.state().pose.x_m, stopping_distance_m(model));
  EXPECT_GT(robot.state().pose.x_m, stopping_distance_m(model) - 0.8 * 0.005);
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

/// What the figures of the shipped specs were measured with.
TEST(RobotModel, TheGentleJackalIsAsItWas) {
  const RobotModel model = RobotModel::by_name("jackal-gentle");
  EXPECT_EQ(model.length_m, 0.508);
  EXPECT_EQ(model.width_m, 0.430);
  EXPECT_EQ(model.height_m, 0.250);
  EXPECT_EQ(model.body_top_m, 0.60);
  EXPECT_EQ(model.clearance_m, 0.06);
  EXPECT_EQ(model.mast_height_m, 1.25);
  EXPECT_EQ(model.mast_radius_m, 0.05);
  EXPECT_EQ(model.max_forward_mps, 0.8);
  EXPECT_EQ(model.max_turn_radps, 1.57);
  EXPECT_EQ(model.max_acceleration_mps2, 2.0);
  EXPECT_EQ(model.max_deceleration_mps2, 2.0);
  EXPECT_EQ(model.max_turn_acceleration_radps2, 4.0);
  EXPECT_EQ(model.wheel_radius_m, 0.098);
  EXPECT_EQ(model.track_m, 0.37559);
  EXPECT_EQ(model.separation_multiplier, 1.5);
  EXPECT_EQ(model.max_wheel_mps, 1.2);
  EXPECT_EQ(model.command_timeout_s, 0.25);
  EXPECT_EQ(model.file, "");
}

constexpr const char* kOwnRobot = R"(schema: segsim.robot/1
name: box
title: A box on wheels
base: {length_m: 0.5, width_m: 0.3, height_m: 0.2}
body_top_m: 0.4
clearance_m: 0.02
camera_height_m: 0.35
limits:
  forward_mps: 0.5
  turn_radps: 1.0
  acceleration_mps2: 1.0
  deceleration_mps2: 1.5
  turn_acceleration_radps2: 2.0
wheels: {radius_m: 0.05, track_m: 0.25, max_mps: 0.6}
)";

/// The file of a robot with one piece of its text replaced.
std::filesystem::path own_robot(const std::string& piece = {}, const std::string& by = {}) {
  std::string text = kOwnRobot;
  if (const std::size_t at = text.find(piece); !piece.empty()) {
    EXPECT_NE(at, std::string::npos) << piece;
    text.replace(at, piece.size(), by);
  }
  const auto file = std::filesystem::path(testing::TempDir()) / "own_robot.yaml";
  core::write_file_atomically(file, [&](std::ostream& out) { out << text; });
  return file;
}

std::string refusal(const std::string& piece, const std::string& by) {
  try {
    (void)RobotModel::load(own_robot(piece, by));
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(RobotModel, OnesOwnComesFromAFile) {
  const std::string file = own_robot().string();
  const RobotModel model = RobotModel::by_name(file);
  EXPECT_EQ(model.file, file);
  EXPECT_EQ(model.title, "A box on wheels");
  EXPECT_EQ(model.width_m, 0.3);
  EXPECT_EQ(model.mast_height_m, 0.0) << "no mast";
  EXPECT_EQ(model.camera_height_m, 0.35);
  EXPECT_EQ(model.separation_multiplier, 1.0);
  EXPECT_EQ(model.max_wheel_mps, 0.6);
  // Its name tells it from what the same file says another day.
  EXPECT_EQ(model.name.substr(0, 4), "box@");
  EXPECT_EQ(RobotModel::load(own_robot()).name, model.name);
  EXPECT_NE(RobotModel::load(own_robot("0.3,", "0.4,")).name, model.name);
}

TEST(RobotModel, MistakesInAFileAreNamed) {
  using testing::HasSubstr;
  EXPECT_THAT(refusal("width_m: 0.3", "width: 0.3"), HasSubstr("own_robot.yaml:4"));
  EXPECT_THAT(refusal("max_mps: 0.6", "max_mps: 0.6, spokes: 8"), HasSubstr("spokes"));
  EXPECT_THAT(refusal("camera_height_m", "camera_hight_m"), HasSubstr("camera_height_m"));
  EXPECT_THAT(refusal("forward_mps: 0.5", "forward_mps: -1"), HasSubstr("above 0"));
  EXPECT_THAT(refusal("forward_mps: 0.5", "forward_mps: fast"),
              HasSubstr("limits.forward_mps"));
  EXPECT_THAT(refusal("length_m: 0.5", "length_m: 1.9"), HasSubstr("circle of 0.8 m"));
  EXPECT_THAT(refusal("body_top_m: 0.4", "body_top_m: 0.05"), HasSubstr("clearance_m"));
  EXPECT_THAT(refusal("robot/1", "robot/2"), HasSubstr("segsim.robot/1"));
  EXPECT_THAT(refusal("name: box", "name: a box"), HasSubstr("without spaces"));
  EXPECT_EQ(refusal("", ""), "accepted");
  EXPECT_THROW((void)RobotModel::by_name("missing/robot.yaml"), core::InputError);
}

TEST(RobotModel, ASpecNamesABuiltInOneOrAFile) {
  const auto read = [](const std::string& text) {
    const core::ConfigNode root =
        core::ConfigNode::parse("robot: " + text + "\n", "spec.yaml");
    return RobotModel::read(root.child("robot"), [](const core::ConfigNode&) {
      return own_robot();  // As if the text held variables.
    });
  };
  EXPECT_EQ(read("generic-diff").name, "generic-diff");
  EXPECT_EQ(read("${spec}/own_robot.yaml").name, RobotModel::load(own_robot()).name);
  try {
    (void)read("jackel");
    FAIL() << "accepted";
  } catch (const core::InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("spec.yaml:1"));
    EXPECT_THAT(error.what(), testing::HasSubstr("near: jackal"));
  }
}

/// Whoever adds a profile gets this test with it.
TEST(RobotModel, EveryProfileIsWhole) {
  EXPECT_GE(RobotModel::names().size(), 4U);
  for (const std::string& name : RobotModel::names()) {
    SCOPED_TRACE(name);
    const RobotModel model = RobotModel::by_name(name);
    EXPECT_EQ(model.name, name);
    EXPECT_GT(model.inscribed_radius_m(), 0.1);
    EXPECT_GT(model.max_forward_mps, 0.0);
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
    EXPECT_LE(robot.state().pose.x_m - from_m, stopping_distance_m(model));
  }
}

}  // namespace
}  // namespace segsim::sim
