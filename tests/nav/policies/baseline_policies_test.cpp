#include "nav/policies/baseline_policies.h"

#include <gtest/gtest.h>

#include "core/check.h"
#include "tests/nav/box_world.h"
#include "tests/nav/test_view.h"

namespace segsim::nav {
namespace {

using namespace test;

SimulationOptions small_camera(std::uint64_t seed = 1) {
  SimulationOptions options;
  options.camera = core::CameraIntrinsics::from_fov(64, 48, 1.3788);
  options.min_object_px = 10;
  options.seed = seed;
  options.time_limit_s = 60.0;
  return options;
}

TEST(BaselinePolicies, OraclePathDrivesItsWayAndLooksForTheGoal) {
  BoxWorld world = four_rooms();
  world.object = Box{{5.2, 0.3, 0.0}, {5.8, 0.8, 0.8}};
  const glm::dvec2 view_point(6.1, 1.6);
  auto policy = make_oracle_path_policy([&](const glm::dvec2& from) {
    // Behind the door a way never leads back to it.
    if (from.y < 2.8 || from.x < 5.0) return std::vector<glm::dvec2>{from, view_point};
    // Through the door at (6.05, 3.3).
    std::vector<glm::dvec2> way{from};
    if (from.y > 3.6) way.emplace_back(6.05, 3.9);
    way.emplace_back(6.05, 2.7);
    way.push_back(view_point);
    return way;
  });
  const SimulationResult result = run_episode(world, {8.5, 4.0, 0.0}, small_camera(), *policy);
  EXPECT_TRUE(result.success()) << result.stop_reason << " " << result.to_object_m;
  EXPECT_EQ(result.contacts, 0);
}

/// If something stops the robot, it backs out. Then it follows the same path slowly until it
/// is away.
TEST(BaselinePolicies, AfterItWasHeldTheOracleIsCareful) {
  auto policy = make_oracle_path_policy([](const glm::dvec2& from) {
    return std::vector<glm::dvec2>{from, {8.0, 0.0}};
  });
  policy->reset({"thing", 0}, 1);
  TestView view({}, 3.0F, 1.1);
  core::TimeNs time_ns = 0;
  const auto speed_mps = [&](double x_m) {
    view.move_to({x_m, 0.0, 0.0});
    view.observation.capture_time_ns = time_ns += core::kNsPerSecond / 4;
    return policy->decide(view.observation, {}).command.forward_mps;
  };
  EXPECT_GT(speed_mps(0.0), 0.4);
  double back_mps = 0.0;
  for (int k = 0; k < 8; ++k) back_mps = std::min(back_mps, speed_mps(0.1));
  EXPECT_LT(back_mps, 0.0);
  double x_m = 0.1;
  for (; speed_mps(x_m) < 0.0; x_m -= 0.03) {
  }
  for (; x_m < 1.3; x_m += 0.07) EXPECT_LE(speed_mps(x_m), 0.3 + 1e-9) << x_m;
  EXPECT_GT(speed_mps(2.0), 0.4);
}

TEST(BaselinePolicies, WithoutAWayTheOracleSaysSo) {
  auto policy =
      make_oracle_path_policy([](const glm::dvec2&) { return std::vector<glm::dvec2>(); });
  const SimulationResult result =
      run_episode(four_rooms(), {8.5, 4.0, 0.0}, small_camera(), *policy);
  EXPECT_EQ(result.stop_reason, "no_path");
  EXPECT_EQ(result.ticks, 0);
  EXPECT_THROW((void)make_oracle_path_policy(nullptr), core::ContractViolation);
}

TEST(BaselinePolicies, ChanceFollowsTheSeed) {
  const auto run = [](std::uint64_t seed) {
    auto policy = make_random_policy();
    return run_episode(four_rooms(), {5.0, 4.0, 0.0}, small_camera(seed), *policy);
  };
  const SimulationResult a = run(3), b = run(3), c = run(4);
  ASSERT_EQ(a.track.size(), b.track.size());
  EXPECT_EQ(a.track.back().x_m, b.track.back().x_m);
  EXPECT_NE(a.pose.x_m, c.pose.x_m);
  EXPECT_GT(a.path_m, 0.2);
  RandomPolicyOptions always;
  always.stop_chance = 1.0;
  auto policy = make_random_policy(always);
  EXPECT_EQ(run_episode(four_rooms(), {5.0, 4.0, 0.0}, small_camera(), *policy).stop_reason,
            "random_stop");
}

TEST(BaselinePolicies, AScriptIsCarriedOut) {
  using enum DiscreteAction;
  auto policy =
      make_script_policy({kForward, kForward, kTurnLeft, kTurnLeft, kTurnLeft, kForward});
  const SimulationResult result =
      run_episode(four_rooms(), {5.0, 4.0, 0.0}, small_camera(), *policy);
  EXPECT_EQ(result.stop_reason, "script_end");
  EXPECT_NEAR(result.pose.x_m, 5.5, 0.08);
  EXPECT_NEAR(result.pose.y_m, 4.25, 0.08);
  EXPECT_NEAR(result.pose.yaw_rad, 0.5 * std::numbers::pi, 0.16);
  auto nothing = make_script_policy({});
  EXPECT_EQ(run_episode(four_rooms(), {5.0, 4.0, 0.0}, small_camera(), *nothing).ticks, 0);
}

}  // namespace
}  // namespace segsim::nav
