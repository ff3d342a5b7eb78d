/// Whole episodes in a world of boxes.

#include "nav/frontier/frontier_policy.h"

#include <array>

#include <gmock/gmock.h>

#include "core/check.h"
#include "tests/nav/box_world.h"

namespace segsim::nav {
namespace {

using namespace test;

constexpr std::array<core::Pose2, 5> kStarts{
    {{1.0, 2.6, 0.0}, {8.5, 2.0, -1.0}, {9.3, 4.0, 3.1}, {3.0, 5.4, 2.0}, {5.0, 6.0, 1.0}}};
const std::array<Box, 4> kObjects{{{{9.3, 7.3, 0.0}, {9.8, 7.8, 0.9}},
                                   {{2.9, 0.2, 0.0}, {3.4, 0.7, 0.45}},
                                   {{0.2, 5.2, 0.0}, {0.7, 5.7, 0.8}},
                                   {{5.2, 0.3, 0.0}, {5.8, 0.8, 0.8}}}};

SimulationOptions small_camera(std::uint64_t seed) {
  SimulationOptions options;
  options.camera = core::CameraIntrinsics::from_fov(96, 72, 1.3788);
  options.min_object_px = 15;
  options.seed = seed;
  options.depth_noise = 0.003;
  options.box_jitter_px = 0.7;
  return options;
}

TEST(FrontierPolicy, FindsTheObjectFromEverywhere) {
  int successes = 0, episodes = 0;
  for (std::size_t k = 0; k < kObjects.size() * kStarts.size(); ++k) {
    BoxWorld world = four_rooms();
    world.object = kObjects[k % kObjects.size()];
    const core::Pose2 start = kStarts[k / kObjects.size()];
    auto policy = make_frontier_policy({});
    const SimulationResult result = run_episode(world, start, small_camera(k + 1), *policy);
    ++episodes;
    successes += result.success() ? 1 : 0;
    EXPECT_TRUE(result.spun);
    EXPECT_LE(result.max_forward_mps, FollowerOptions{}.max_forward_mps + 1e-9);
    EXPECT_LE(result.max_turn_radps, FollowerOptions{}.max_turn_radps + 1e-9);
    EXPECT_LE(result.contacts, 3);
    if (!result.success()) {
      std::printf("object %zu start %zu: '%s' after %.1f s, %.2f m away\n",
                  k % kObjects.size(), k / kObjects.size(), result.stop_reason.c_str(),
                  result.time_s, result.to_object_m);
    }
  }
  EXPECT_GE(successes, static_cast<int>(0.95 * episodes));
}

TEST(FrontierPolicy, ExploresEverythingAndSaysSoWhenThereIsNothing) {
  auto policy = make_frontier_policy({});
  const SimulationResult result =
      run_episode(four_rooms(), kStarts[0], small_camera(3), *policy);
  EXPECT_EQ(result.stop_reason, "no_frontier_left");
  // All four rooms and the corridor were seen: the free area is at least 85 % of the floor.
  const auto free_cells =
      std::count_if(result.view.cells.pixels().begin(), result.view.cells.pixels().end(),
                    [](std::uint8_t cell) { return cell == 1 || cell == 3; });
  const double free_m2 = static_cast<double>(free_cells) * 0.05 * 0.05;
  EXPECT_GT(free_m2, 0.85 * (80.0 - 9.0));
  EXPECT_LT(free_m2, 82.0);
}

TEST(FrontierPolicy, OneSpuriousDetectionDoesNotEndTheEpisode) {
  SimulationOptions options = small_camera(4);
  for (const int tick : {10, 60}) options.false_positives.push_back({tick, {30, 25, 60, 60}});
  auto policy = make_frontier_policy({});
  const SimulationResult result = run_episode(four_rooms(), kStarts[0], options, *policy);
  EXPECT_EQ(result.stop_reason, "no_frontier_left");
}

TEST(FrontierPolicy, APersistentFalsePositiveDoesEndIt) {
  // The detector calls the wardrobe the object, always: the policy has no way to know better.
  BoxWorld world = four_rooms();
  world.object = world.boxes[16];
  world.boxes.erase(world.boxes.begin() + 16);
  auto policy = make_frontier_policy({});
  const SimulationResult result = run_episode(world, kStarts[1], small_camera(5), *policy);
  EXPECT_EQ(result.stop_reason, "goal_reached");
}

TEST(FrontierPolicy, RecoversFromWhatTheCameraDoesNotSee) {
  BoxWorld world = four_rooms();
  world.object = kObjects[1];
  world.invisible.push_back(
      {{2.4, 3.4, 0.0}, {2.5, 3.85, 0.5}});  // Glass across the corridor's half.
  auto policy = make_frontier_policy({});
  SimulationOptions options = small_camera(6);
  const SimulationResult result = run_episode(world, {0.6, 3.9, 0.0}, options, *policy);
  EXPECT_TRUE(result.success()) << result.stop_reason << " " << result.time_s;
}

TEST(FrontierPolicy, IsRecoveringWhenItCannotMove) {
  BoxWorld world = four_rooms();
  const core::Pose2 start{6.0, 4.0, 0.0};
  // Glass all around: the robot can only turn.
  for (const double d : {-0.4, 0.3}) {
    world.invisible.push_back(
        {{start.x_m - 0.4, start.y_m + d, 0.0}, {start.x_m + 0.4, start.y_m + d + 0.1, 0.5}});
    world.invisible.push_back(
        {{start.x_m + d, start.y_m - 0.4, 0.0}, {start.x_m + d + 0.1, start.y_m + 0.4, 0.5}});
  }
  SimulationOptions options = small_camera(7);
  auto policy = make_frontier_policy({});
  const SimulationResult result = run_episode(world, start, options, *policy);
  EXPECT_TRUE(result.recovered);
  EXPECT_EQ(result.stop_reason, "no_frontier_left");
}

TEST(FrontierPolicy, EqualSeedsGiveEqualTracksAndResetForgets) {
  BoxWorld world = four_rooms();
  world.object = kObjects[0];
  SimulationOptions options = small_camera(8);
  options.time_limit_s = 25.0;
  auto policy = make_frontier_policy({});
  const SimulationResult first = run_episode(world, kStarts[3], options, *policy);
  run_episode(world, kStarts[1], options, *policy);
  const SimulationResult again = run_episode(world, kStarts[3], options, *policy);
  ASSERT_EQ(first.track.size(), again.track.size());
  for (std::size_t k = 0; k < first.track.size(); ++k) {
    ASSERT_EQ(first.track[k].x_m, again.track[k].x_m);
    ASSERT_EQ(first.track[k].yaw_rad, again.track[k].yaw_rad);
  }
}

TEST(FrontierPolicy, StopStaysAndTheViewIsFilled) {
  BoxWorld world = four_rooms();
  world.object = kObjects[1];
  Simulation simulation(world, {4.3, 1.0, 2.5}, small_camera(9));
  auto policy = make_frontier_policy({});
  policy->reset({"thing", 0}, 1);
  core::Decision decision;
  for (int k = 0; k < 300 && !decision.stop; ++k) {
    const core::Observation& observation = simulation.observe();
    decision = policy->decide(observation, simulation.detect());
    simulation.step(decision.command);
  }
  ASSERT_TRUE(decision.stop);
  const core::Observation& observation = simulation.observe();
  decision = policy->decide(observation, {});
  EXPECT_TRUE(decision.stop);
  EXPECT_EQ(decision.mode, core::PolicyMode::kStop);
  EXPECT_EQ(decision.command.forward_mps, 0.0);
  const core::PolicyView view = policy->view();
  EXPECT_EQ(view.resolution_m, 0.05);
  EXPECT_GT(view.cells.width_px(), 60);
  ASSERT_FALSE(view.objects.empty());
  EXPECT_NEAR(view.objects[0].position_m.x, 3.15, 0.4);
  EXPECT_NEAR(view.objects[0].position_m.y, 0.45, 0.4);
}

TEST(FrontierPolicy, RefusesWrongOptions) {
  FrontierPolicyOptions options;
  options.spin.rate_radps = 0.0;
  EXPECT_THROW(make_frontier_policy(options), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::nav
