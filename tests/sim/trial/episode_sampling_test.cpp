#include "sim/trial/episode_sampling.h"

#include <cmath>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "tests/sim/rooms.h"

namespace segsim::sim {
namespace {

class EpisodeSampling : public testing::Test {
 protected:
  World world_ = World::from_mesh(make_two_rooms(), RobotModel::jackal());
  glm::dvec3 box_min_m_{4.5, 0.0, 0.0}, box_max_m_{5.5, 0.6, 0.8};
};

TEST_F(EpisodeSampling, ViewPointsAreFreeAndNear) {
  const auto points = view_point_candidates(world_, box_min_m_, box_max_m_);
  ASSERT_GT(points.size(), 10U);
  for (const glm::dvec2& p : points) {
    EXPECT_TRUE(world_.free_space().is_free(p));
    const double dx = std::max({4.5 - p.x, 0.0, p.x - 5.5});
    const double dy = std::max(0.0, p.y - 0.6);
    EXPECT_LE(std::hypot(dx, dy), 1.0);
    EXPECT_NEAR(std::remainder(p.x, 0.25), 0.0, 1e-12);
  }
  EXPECT_TRUE(view_point_candidates(world_, {20, 20, 0}, {21, 21, 1}).empty());
}

TEST_F(EpisodeSampling, FacingLooksAtTheBox) {
  const core::Pose2 pose = facing({5.0, 1.3}, box_min_m_, box_max_m_);
  EXPECT_NEAR(pose.yaw_rad, -std::acos(-1.0) / 2, 1e-12);
}

TEST_F(EpisodeSampling, StartsObeyTheRulesAndRepeat) {
  const auto goals = view_point_candidates(world_, box_min_m_, box_max_m_);
  StartRules rules;
  rules.min_geodesic_m = 2.0;
  rules.max_geodesic_m = 6.0;
  StartRejections refused;
  const auto starts = sample_starts(world_, goals, 50, 7, rules, &refused);
  ASSERT_EQ(starts.size(), 50U);
  const DistanceField field = world_.distance_to(goals);
  int other_room = 0;
  for (const SampledStart& start : starts) {
    const glm::dvec2 p(start.pose.x_m, start.pose.y_m);
    EXPECT_DOUBLE_EQ(start.geodesic_m, field.at(p));
    EXPECT_GE(start.geodesic_m, 2.0);
    EXPECT_LE(start.geodesic_m, 6.0);
    EXPECT_FALSE(world_.collision().collides(start.pose));
    EXPECT_GE(world_.collision().body_distance_m(p), 0.333 + 0.05);
    other_room += p.x < 3.0 ? 1 : 0;
  }
  EXPECT_GT(other_room, 25);
  EXPECT_GT(refused.too_near, 0);
  const auto again = sample_starts(world_, goals, 50, 7, rules);
  EXPECT_EQ(again[49].pose.x_m, starts[49].pose.x_m);
  EXPECT_NE(sample_starts(world_, goals, 1, 8, rules)[0].pose.x_m, starts[0].pose.x_m);
  // A longer list begins with the shorter one.
  EXPECT_EQ(sample_starts(world_, goals, 10, 7, rules)[9].pose.x_m, starts[9].pose.x_m);
}

TEST_F(EpisodeSampling, ImpossibleRulesGiveFewerAndSayWhy) {
  const auto goals = view_point_candidates(world_, box_min_m_, box_max_m_);
  StartRules rules;
  rules.min_geodesic_m = 100.0;
  rules.max_geodesic_m = 200.0;
  rules.max_tries = 300;
  StartRejections refused;
  EXPECT_TRUE(sample_starts(world_, goals, 5, 1, rules, &refused).empty());
  EXPECT_EQ(refused.too_near, 300);
  EXPECT_TRUE(sample_starts(world_, {}, 5, 1, rules, &refused).empty());
  EXPECT_EQ(refused.unreachable, 300);
}

}  // namespace
}  // namespace segsim::sim
