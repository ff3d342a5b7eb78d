/// What both search policies do at the edges: long episodes, images without depth, doors that
/// are too narrow, poses that leave the map. Every outcome has a name, no command is not a
/// number, and memory stays bounded.

#include <string>

#include <gtest/gtest.h>

#include "nav/frontier/frontier_policy.h"
#include "nav/vlfm/vlfm_policy.h"
#include "tests/nav/box_world.h"
#include "tests/nav/robots.h"
#include "tests/nav/test_view.h"

namespace segsim::nav {
namespace {

using namespace test;

constexpr double kMast_m = 1.1;
const std::vector<std::string> kPolicies{"frontier", "frontier-dwa", "vlfm", "vlfm-published"};

std::unique_ptr<core::Policy> make(const std::string& name) {
  FrontierPolicyOptions frontier;
  if (name == "frontier-dwa") frontier.follower.motion = LocalMotion::kDynamicWindow;
  if (name.starts_with("frontier")) return make_frontier_policy(frontier);
  return make_vlfm_policy(vlfm_for(
      test::jackal(), VlfmRules(name == "vlfm" ? Rule::kFixed : Rule::kVlfm), kMast_m));
}

TEST(Endurance, TenThousandStepsOnACircleStayBounded) {
  for (const std::string name : {"frontier", "vlfm"}) {
    auto policy = make(name);
    policy->reset({"thing", 0}, 1);
    TestView view({}, 1.5F, kMast_m, 16, 12);
    std::size_t after_one_round = 0;
    for (int step = 0; step < 10'000; ++step) {
      const double a = 2.0 * kPi * (step % 200) / 200.0;
      view.move_to({4.0 * std::cos(a), 4.0 * std::sin(a), a + 0.5 * kPi});
      view.observation.capture_time_ns = step * core::kNsPerSecond / 4;
      const core::Decision d = policy->decide(view.observation, {});
      ASSERT_TRUE(std::isfinite(d.command.forward_mps + d.command.turn_radps)) << name;
      // A policy that gave up begins anew: the maps go on for all of the steps.
      if (d.stop) policy->reset({"thing", 0}, 1);
      if (step == 400) after_one_round = policy->view().cells.size();
    }
    EXPECT_LE(policy->view().cells.size(), std::max<std::size_t>(after_one_round, 1) * 2)
        << name;
    EXPECT_LE(policy->view().cells.size(), 1'000'000U) << name;
  }
}

TEST(Endurance, ImagesWithoutDepthEndInANamedWay) {
  for (const std::string& name : kPolicies) {
    for (const float depth : {kNan, std::numeric_limits<float>::infinity(), 0.0F}) {
      auto policy = make(name);
      policy->reset({"thing", 0}, 1);
      TestView view({}, depth, kMast_m, 24, 18);
      const core::Detection everywhere{0, 0.9F, {-10, -10, 1000, 1000}};
      double yaw = 0.0;
      core::Decision d;
      for (int k = 0; k < 1500 && !d.stop; ++k) {
        view.observation.capture_time_ns = k * core::kNsPerSecond / 4;
        view.move_to({0.0, 0.0, yaw});  // Turns as told, and never gets anywhere.
        d = policy->decide(view.observation, {&everywhere, 1});
        ASSERT_TRUE(std::isfinite(d.command.forward_mps + d.command.turn_radps)) << name;
        yaw += 0.25 * d.command.turn_radps;
      }
      // Whatever is commanded, the robot only turns. The plain follower calls that stuck; the
      // others give up one frontier after the other.
      EXPECT_EQ(core::to_string(d.stop),
                std::string(name == "frontier" ? "stuck" : "no_frontier_left"))
          << name << " " << depth;
    }
  }
}

TEST(Endurance, APoseThatIsNoNumberIsWaitedOutOneFarAwayEndsTheEpisode) {
  for (const std::string& name : kPolicies) {
    auto policy = make(name);
    policy->reset({"thing", 0}, 1);
    TestView view({}, 3.0F, kMast_m);
    view.move_to({std::nan(""), 0.0, 0.0});
    EXPECT_FALSE(policy->decide(view.observation, {}).stop) << name;
    view.move_to({0.0, 0.0, 0.0});
    view.observation.capture_time_ns = core::kNsPerSecond;
    EXPECT_FALSE(policy->decide(view.observation, {}).stop) << name;
    view.move_to({500.0, 0.0, 0.0});
    view.observation.capture_time_ns = 2 * core::kNsPerSecond;
    const core::Decision d = policy->decide(view.observation, {});
    EXPECT_EQ(d.stop, core::StopReason::kMapExhausted) << name;
  }
}

/// Two rooms with the object in the other one.
BoxWorld two_rooms(double door_m) {
  WorldBuilder b;
  b.wall_x(0, 0, 7);
  b.wall_x(4, 0, 7);
  b.wall_y(0, 0, 4);
  b.wall_y(7, 0, 4);
  b.wall_y(3.5, 0, 4, 2.0 - 0.5 * door_m, 2.0 + 0.5 * door_m);
  b.world.object = Box{{6.2, 2.6, 0.0}, {6.7, 3.1, 0.8}};
  return b.world;
}

TEST(Endurance, ADoorIsPassedIfTheRobotFits) {
  SimulationOptions camera;
  camera.camera = core::CameraIntrinsics::from_fov(96, 72, 1.3788);
  camera.min_object_px = 15;
  camera.mast_m = kMast_m;
  camera.period_s = 0.25;
  camera.time_limit_s = 120.0;
  for (const std::string& name : kPolicies) {
    if (name == "vlfm-published") continue;
    auto narrow = make(name);
    const SimulationResult shut =
        run_episode(two_rooms(0.35), {1.0, 1.0, 0.3}, camera, *narrow);
    EXPECT_FALSE(shut.success()) << name;
    EXPECT_EQ(shut.stop_reason, "no_frontier_left") << name;
    EXPECT_LT(shut.pose.x_m, 3.5) << name;
    auto wide = make(name);
    const SimulationResult open = run_episode(two_rooms(0.90), {1.0, 1.0, 0.3}, camera, *wide);
    EXPECT_TRUE(open.success()) << name << ": " << open.stop_reason << " " << open.to_object_m;
  }
}

}  // namespace
}  // namespace segsim::nav
