#include "nav/motion/path_follower.h"

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <glm/geometric.hpp>

#include "tests/nav/text_map.h"

namespace segsim::nav {
namespace {

using test::text_map;

CostMap open_map() {
  return text_map(std::vector<std::string>(80, std::string(80, '.')), test::thin_options());
}

Path path_of(std::vector<glm::dvec2> points) {
  Path path;
  path.points_m = std::move(points);
  return path;
}

TEST(Advance, EqualsManySmallSteps) {
  const core::VelocityCommand command{0.6, -1.1};
  core::Pose2 fine{1.0, 2.0, 0.5};
  for (int k = 0; k < 100000; ++k) {
    fine.x_m += 0.6 * 1e-5 * std::cos(fine.yaw_rad);
    fine.y_m += 0.6 * 1e-5 * std::sin(fine.yaw_rad);
    fine.yaw_rad -= 1.1 * 1e-5;
  }
  const core::Pose2 exact = advance({1.0, 2.0, 0.5}, command, 1.0);
  EXPECT_NEAR(exact.x_m, fine.x_m, 1e-4);
  EXPECT_NEAR(exact.y_m, fine.y_m, 1e-4);
  EXPECT_NEAR(exact.yaw_rad, fine.yaw_rad, 1e-6);
}

TEST(PathFollower, KeepsNearAnArcAndWithinTheLimits) {
  std::vector<glm::dvec2> arc;
  for (double a = 0.0; a <= 1.6; a += 0.1)
    arc.push_back({2.0 + 2.0 * std::sin(a), 4.0 - 2.0 * std::cos(a)});
  const CostMap map = open_map();
  FollowerOptions options;
  PathFollower follower(options);
  follower.set_path(path_of(arc));
  core::Pose2 pose{2.0, 2.0, 0.0};
  int ticks = 0;
  for (; ticks < 200 && !follower.arrived(pose); ++ticks) {
    const core::VelocityCommand command = follower.follow(pose, map);
    EXPECT_LE(command.forward_mps, options.max_forward_mps + 1e-9);
    EXPECT_LE(std::abs(command.turn_radps), options.max_turn_radps + 1e-9);
    EXPECT_GE(command.forward_mps, 0.0);
    pose = advance(pose, command, 0.1);
    EXPECT_NEAR(glm::distance(glm::dvec2(pose.x_m, pose.y_m), glm::dvec2(2.0, 4.0)), 2.0,
                0.12);
  }
  EXPECT_LT(ticks, 80);  // 3.2 m at up to 0.8 m/s.
}

TEST(PathFollower, TurnsOnTheSpotWhenThePathIsBehind) {
  PathFollower follower;
  follower.set_path(path_of({{4.0, 4.0}, {2.0, 4.0}}));
  const core::VelocityCommand command = follower.follow({4.0, 4.0, 0.3}, open_map());
  EXPECT_EQ(command.forward_mps, 0.0);
  EXPECT_GT(command.turn_radps, 0.5);  // From 0.3 rad the short way to pi is left.
}

TEST(PathFollower, NeverDrivesIntoAnOccupiedCell) {
  std::vector<std::string> lines(40, std::string(40, '.'));
  for (int j = 5; j < 35; ++j) lines[static_cast<std::size_t>(j)][25] = '#';
  const CostMap map = text_map(lines, test::thin_options());
  PathFollower follower;
  follower.set_path(path_of({{1.0, 2.0}, {3.8, 2.0}}));  // Straight through the wall.
  core::Pose2 pose{1.0, 2.0, 0.0};
  bool blocked = false;
  for (int k = 0; k < 150; ++k) {
    pose = advance(pose, follower.follow(pose, map), 0.1);
    blocked |= follower.blocked();
    EXPECT_GE(map.clearance_m(map.frame().cell_at({pose.x_m, pose.y_m})), 0.29F);
  }
  EXPECT_TRUE(blocked);
  EXPECT_GT(pose.x_m, 1.6);  // It went as far as it could.
}

TEST(PathFollower, MayLeaveAViolatedFootprint) {
  std::vector<std::string> lines(40, std::string(40, '.'));
  for (std::string& line : lines) line[10] = '#';
  const CostMap map = text_map(lines, test::thin_options());
  PathFollower follower;
  const core::Pose2 pose{1.25, 2.0, 0.0};  // 0.2 m from the wall, facing away.
  EXPECT_TRUE(follower.safe(pose, {0.5, 0.0}, map));
  EXPECT_FALSE(follower.safe(pose, {-0.2, 0.0}, map));
}

TEST(PathFollower, TurnToConvergesFromEverywhere) {
  PathFollower follower;
  for (double yaw = -3.1; yaw < 3.1; yaw += 0.4) {
    core::Pose2 pose{0, 0, yaw};
    for (int k = 0; k < 80; ++k) pose = advance(pose, follower.turn_to(pose, 2.9, 0.1), 0.1);
    EXPECT_LE(std::abs(core::wrap_angle_rad(pose.yaw_rad - 2.9)), 0.1) << yaw;
  }
}

TEST(PathFollower, WithoutAPathItStands) {
  PathFollower follower;
  const core::VelocityCommand command = follower.follow({1, 1, 0}, open_map());
  EXPECT_EQ(command.forward_mps, 0.0);
  EXPECT_EQ(command.turn_radps, 0.0);
}

}  // namespace
}  // namespace segsim::nav
