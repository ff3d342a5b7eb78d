/// Two robots and one doorway that only one of them fits through: what is planned depends on
/// the robot.

#include <gmock/gmock.h>

#include "nav/frontier/frontier_policy.h"
#include "nav/vlfm/vlfm_policy.h"
#include "tests/nav/box_world.h"
#include "tests/nav/robots.h"

namespace segsim::nav {
namespace {

using namespace test;

constexpr double kMast_m = 1.1;
constexpr double kDoor_m = 0.42;     // The Jackal is 0.43 m wide, the small robot 0.24 m.
constexpr double kDoorWall_x = 3.5;  // Of the middle of the wall with the doorway.

/// Two rooms with the object in the other one. @param detour  A second doorway, 1 m wide.
BoxWorld two_rooms(bool detour) {
  WorldBuilder b;
  b.wall_x(0, 0, 7);
  b.wall_x(5, 0, 7);
  b.wall_y(0, 0, 5);
  b.wall_y(7, 0, 5);
  b.wall_y(kDoorWall_x, 0, 3.4, 1.2 - 0.5 * kDoor_m, 1.2 + 0.5 * kDoor_m);
  if (detour) {
    b.wall_y(kDoorWall_x, 4.4, 5);
  } else {
    b.wall_y(kDoorWall_x, 3.4, 5);
  }
  b.world.object = Box{{6.2, 0.9, 0.0}, {6.7, 1.4, 0.8}};
  return b.world;
}

std::unique_ptr<core::Policy> policy_of(const std::string& name,
                                        const core::RobotBase& robot) {
  if (name == "frontier") return make_frontier_policy(frontier_for(robot));
  if (name == "frontier-dwa") {
    FrontierPolicyOptions options = frontier_for(robot);
    options.follower.motion = LocalMotion::kDynamicWindow;
    return make_frontier_policy(options);
  }
  return make_vlfm_policy(vlfm_for(robot, VlfmRules(), kMast_m));
}

SimulationResult search(const std::string& name, const core::RobotBase& robot, bool detour) {
  SimulationOptions options;
  options.camera = core::CameraIntrinsics::from_fov(96, 72, 1.3788);
  options.min_object_px = 15;
  options.mast_m = kMast_m;
  options.period_s = 0.25;
  options.time_limit_s = 200.0;
  options.body_radius_m = robot.inscribed_radius_m();
  return run_episode(two_rooms(detour), {1.0, 1.2, 0.0}, options, *policy_of(name, robot));
}

/// Where the robot crossed the middle of the wall; NaN if it never did.
double crossed_at_y(const SimulationResult& result) {
  for (const core::Pose2& pose : result.track) {
    if (pose.x_m > kDoorWall_x) return pose.y_m;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

class Doorway : public testing::TestWithParam<std::string> {};

TEST_P(Doorway, TheNarrowRobotPasses) {
  for (const bool detour : {false, true}) {
    const SimulationResult result = search(GetParam(), small_robot(), detour);
    EXPECT_TRUE(result.success()) << result.stop_reason << " " << result.to_object_m;
    EXPECT_NEAR(crossed_at_y(result), 1.2, 0.5 * kDoor_m);
  }
}

TEST_P(Doorway, TheWideOnePlansAround) {
  const SimulationResult result = search(GetParam(), jackal(), true);
  EXPECT_TRUE(result.success()) << result.stop_reason << " " << result.to_object_m;
  EXPECT_GT(crossed_at_y(result), 3.4);
}

TEST_P(Doorway, WithoutAWayAroundTheWideOneGivesUp) {
  const SimulationResult result = search(GetParam(), jackal(), false);
  EXPECT_FALSE(result.success());
  EXPECT_TRUE(std::isnan(crossed_at_y(result)));
  EXPECT_EQ(result.stop_reason, "no_frontier_left");
}

std::string word(const testing::TestParamInfo<std::string>& policy) {
  std::string name = policy.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

INSTANTIATE_TEST_SUITE_P(Policies, Doorway,
                         testing::Values("frontier", "frontier-dwa", "vlfm"), word);

}  // namespace
}  // namespace segsim::nav
