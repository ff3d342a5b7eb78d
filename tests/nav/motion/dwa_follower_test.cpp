#include "nav/motion/dwa_follower.h"

#include <gmock/gmock.h>

#include "core/check.h"
#include "nav/motion/path_follower.h"
#include "tests/nav/text_map.h"

namespace segsim::nav {
namespace {

using test::random_map;
using test::text_map;
using test::thin_options;

Path straight(const glm::dvec2& from, const glm::dvec2& to) {
  Path path;
  path.points_m = {from, to};
  path.length_m = glm::distance(from, to);
  return path;
}

/// Every cell of the map against the rectangle, by its corners' half planes.
bool brute_force_free(const core::Pose2& pose, const CostMap& map, const DwaOptions& o) {
  const double half = 0.5 * map.frame().resolution_m;
  const double a = o.half_length_m + o.margin_m + half, b = o.half_width_m + o.margin_m + half;
  const glm::dvec2 x(std::cos(pose.yaw_rad), std::sin(pose.yaw_rad)), y(-x.y, x.x);
  const glm::dvec2 center(pose.x_m, pose.y_m);
  const glm::dvec2 corners[4] = {center + a * x + b * y, center - a * x + b * y,
                                 center - a * x - b * y, center + a * x - b * y};
  for (int j = 0; j < map.frame().height_cells; ++j) {
    for (int i = 0; i < map.frame().width_cells; ++i) {
      if (map.state({i, j}) != CellState::kOccupied) continue;
      const glm::dvec2 p = map.frame().center_m({i, j});
      bool inside = true;
      for (int k = 0; k < 4; ++k) {
        const glm::dvec2 edge = corners[(k + 1) % 4] - corners[k], to = p - corners[k];
        inside = inside && edge.x * to.y - edge.y * to.x >= -1e-12;
      }
      if (inside) return false;
    }
  }
  return true;
}

TEST(DwaFollower, FootprintEqualsBruteForce) {
  const DwaOptions options;
  core::RandomStream random(4, "footprint");
  int free = 0, touching = 0;
  for (int round = 0; round < 400; ++round) {
    const CostMap map =
        random_map(30, 0.01, static_cast<std::uint64_t>(round), thin_options());
    const core::Pose2 pose{random.uniform(0.5, 2.5), random.uniform(0.5, 2.5),
                           random.uniform(-3.2, 3.2)};
    const bool truth = brute_force_free(pose, map, options);
    ASSERT_EQ(footprint_free(pose, map, options), truth) << round;
    ++(truth ? free : touching);
  }
  EXPECT_GT(free, 50);
  EXPECT_GT(touching, 50);
}

/// The rectangle turns where a circle around it would not fit.
TEST(DwaFollower, ARectanglePassesWhereItsCircleDoesNot) {
  DwaOptions options;
  options.margin_m = 0.0;
  std::vector<std::string> lines(16, std::string(60, '.'));
  lines[2] = lines[13] = std::string(60, '#');  // 0.5 m between the inner edges, 5 cm cells.
  const CostMap map = text_map(lines, thin_options(), 0.05);
  const core::Pose2 along{1.5, 0.4, 0.0}, across{1.5, 0.4, 1.5708};
  EXPECT_TRUE(footprint_free(along, map, options));
  EXPECT_FALSE(footprint_free(across, map, options));
}

/// All velocities of the window, found again one by one with footprints in finer steps.
TEST(DwaFollower, TheWindowIsWhatCanBeReachedJudgedAsByBruteForce) {
  DwaOptions options;
  options.forward_samples = 5;
  options.turn_samples = 7;
  core::RandomStream random(9, "window");
  int judged = 0;
  for (int round = 0; round < 30; ++round) {
    const CostMap map =
        random_map(60, 0.004, static_cast<std::uint64_t>(100 + round), thin_options());
    const core::Pose2 pose{3.0, 3.0, random.uniform(-3.0, 3.0)};
    if (!brute_force_free(pose, map, options)) continue;
    const core::VelocityCommand now{random.uniform(0.0, 0.8), random.uniform(-1.0, 1.0)};
    const Path path = straight({3.0, 3.0}, {5.5, 4.0});
    const auto candidates = dwa_candidates(pose, now, {3.7, 3.3}, path.points_m, map, options);
    ASSERT_EQ(candidates.size(), 1U + 5U * 7U);
    ++judged;
    for (const DwaCandidate& c : candidates) {
      EXPECT_LE(c.command.forward_mps, 0.8);
      EXPECT_GE(c.command.forward_mps, 0.0);
      EXPECT_LE(std::abs(c.command.turn_radps), 1.2);
      if (&c != &candidates.front()) {
        EXPECT_LE(std::abs(c.command.forward_mps - now.forward_mps), 1.5 * 0.25 + 1e-9);
        EXPECT_LE(std::abs(c.command.turn_radps - now.turn_radps), 4.0 * 0.25 + 1e-9);
      }
      bool free = true;
      const double whole_s = options.horizon_s + 0.5 * c.command.forward_mps / 1.5;
      for (int k = 1; k * options.step_s <= whole_s + 1e-9; ++k) {
        free = free &&
               brute_force_free(advance(pose, c.command, k * options.step_s), map, options);
      }
      ASSERT_EQ(c.admissible, free);
    }
  }
  EXPECT_GT(judged, 10);
}

/// Drives a simulated robot along the path; returns the last pose, fails on contact.
core::Pose2 drive(DwaFollower& follower, core::Pose2 pose, const CostMap& map, int ticks) {
  DwaOptions bare;
  bare.margin_m = 0.0;
  for (int k = 0; k < ticks; ++k) {
    const core::VelocityCommand command = follower.follow(pose, map);
    for (int sub = 0; sub < 5; ++sub) pose = advance(pose, command, 0.05);
    EXPECT_TRUE(footprint_free(pose, map, bare)) << pose.x_m << " " << pose.y_m;
  }
  return pose;
}

TEST(DwaFollower, FollowsAPathThroughADoorWithoutContact) {
  std::vector<std::string> lines(80, std::string(120, '.'));
  for (int j = 0; j < 80; ++j) {
    if (j < 30 || j > 47) lines[static_cast<std::size_t>(j)][60] = '#';  // A door of 0.9 m.
  }
  const CostMap map = text_map(lines, {}, 0.05);
  const auto path = plan_path(map, {1.0, 0.8}, {5.0, 3.2});
  ASSERT_TRUE(path.has_value());
  DwaFollower follower;
  follower.set_path(*path);
  const core::Pose2 end = drive(follower, {1.0, 0.8, -2.0}, map, 160);
  EXPECT_NEAR(end.x_m, 5.0, 0.2);
  EXPECT_NEAR(end.y_m, 3.2, 0.2);
}

TEST(DwaFollower, StopsBeforeAWallAcrossThePathAndSaysSo) {
  std::vector<std::string> lines(40, std::string(80, '.'));
  for (std::string& line : lines) line[40] = '#';
  const CostMap map = text_map(lines, {}, 0.05);
  DwaFollower follower;
  follower.set_path(straight({0.5, 1.0}, {3.5, 1.0}));
  const core::Pose2 end = drive(follower, {0.5, 1.0, 0.0}, map, 60);
  EXPECT_LT(end.x_m, 2.0 - 0.254);
  EXPECT_GT(end.x_m, 0.8);
  EXPECT_TRUE(follower.blocked());
}

TEST(DwaFollower, WithoutAPathOrAtItsEndItStands) {
  const CostMap map = text_map({"........", "........"}, thin_options());
  DwaFollower follower;
  EXPECT_EQ(follower.follow({0.1, 0.1, 0.0}, map).forward_mps, 0.0);
  follower.set_path(straight({0.1, 0.1}, {0.15, 0.1}));
  EXPECT_EQ(follower.follow({0.1, 0.1, 0.0}, map).forward_mps, 0.0);
  DwaOptions bad;
  bad.turn_samples = 0;
  EXPECT_THROW(DwaFollower{bad}, core::ContractViolation);
}

}  // namespace
}  // namespace segsim::nav
