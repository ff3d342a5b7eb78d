#include "sim/ground/distance_field.h"

#include <cmath>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/random.h"
#include "tests/box_mesh.h"
#include "tests/sim/rooms.h"

namespace segsim::sim {
namespace {

double length_of(const std::vector<glm::dvec2>& path) {
  double length = 0.0;
  for (std::size_t k = 1; k < path.size(); ++k) length += glm::distance(path[k - 1], path[k]);
  return length;
}

/// A disc of 0.1 m radius without a mast, so that closed forms are short.
RobotModel small_disc() {
  RobotModel robot = RobotModel::jackal();
  robot.length_m = robot.width_m = 0.2 / std::sqrt(2.0);
  robot.mast_height_m = 0.0;
  return robot;
}

TEST(FreeSpace, IsTheRoomErodedByTheDisc) {
  const CollisionWorld world(make_room(4.0F, 3.0F), RobotModel::jackal());
  const FreeSpace space = make_free_space(world);
  EXPECT_NEAR(space.radius_m, 0.333, 0.001);
  EXPECT_NEAR(space.area_m2(), (4.0 - 2 * 0.333) * (3.0 - 2 * 0.333), 0.35);
  EXPECT_TRUE(space.is_free({0.40, 1.5}));
  EXPECT_FALSE(space.is_free({0.30, 1.5}));
  EXPECT_FALSE(space.is_free({-1.0, 1.5}));
  EXPECT_EQ(space.island_at({2.0, 1.5}), 1);
  EXPECT_EQ(space.nearest_free({-1.0, 1.5}, 0.15), glm::ivec2(-1, -1));
}

TEST(DistanceField, OpenRoomWithinOneAndAHalfPercentInEveryDirection) {
  const CollisionWorld world(make_room(10.0F, 10.0F), small_disc());
  const FreeSpace space = make_free_space(world);
  const glm::dvec2 goal(5.013, 4.987);
  const DistanceField field(space, std::vector<glm::dvec2>{goal});
  core::RandomStream random(2, "points");
  for (int k = 0; k < 2000; ++k) {
    const glm::dvec2 p(random.uniform(0.2, 9.8), random.uniform(0.2, 9.8));
    const double true_m = glm::distance(p, goal);
    const double found_m = field.at(p);
    EXPECT_LE(found_m, 1.015 * true_m + 0.004);
    EXPECT_GE(found_m, 0.999 * true_m - 0.002);
    EXPECT_NEAR(length_of(field.path_from(p)), true_m, 0.002 + 0.002 * true_m);
  }
  EXPECT_NEAR(field.at({9.0, 9.0}), glm::distance(glm::dvec2(9.0), goal), 0.015 * 5.7);
}

TEST(DistanceField, GoesAroundTheWall) {
  const RobotModel robot = small_disc();
  const CollisionWorld world(make_two_rooms(), robot);
  const FreeSpace space = make_free_space(world);
  const glm::dvec2 goal(4.0, 1.0);
  const glm::dvec2 start(2.0, 1.0);
  const DistanceField field(space, std::vector<glm::dvec2>{goal});
  // Closed form: tangents and arcs of radius r around both corners of the wall's end (by
  // symmetry twice one side, plus the top).
  const double r = 0.1;
  const double dx = 0.9;
  const double dy = 1.6;
  const double far = std::hypot(dx, dy);
  const double tangent = std::sqrt(far * far - r * r);
  const double turn = std::acos(dx / far) + std::asin(r / far);
  const double true_m = 2.0 * (tangent + r * turn) + 0.2;
  // Raster and lattice make it longer, never shorter.
  EXPECT_GE(field.at(start), true_m);
  EXPECT_LE(field.at(start), 1.04 * true_m);
  const auto path = field.path_from(start);
  EXPECT_LE(length_of(path), field.at(start) + 1e-6);
  EXPECT_GE(length_of(path), true_m);
  for (std::size_t k = 1; k < path.size(); ++k) {
    for (int s = 0; s <= 20; ++s) {
      const glm::dvec2 p = path[k - 1] + (path[k] - path[k - 1]) * (s / 20.0);
      EXPECT_GT(world.body_distance_m(p), r - 0.03);
    }
  }
}

TEST(DistanceField, SeveralGoalsGiveTheMinimum) {
  const CollisionWorld world(make_two_rooms(), small_disc());
  const FreeSpace space = make_free_space(world);
  const std::vector<glm::dvec2> goals = {{1.0, 1.0}, {5.0, 3.0}, {4.0, 0.5}};
  const DistanceField all(space, goals);
  std::vector<DistanceField> single;
  for (const glm::dvec2& goal : goals) single.emplace_back(space, std::span(&goal, 1));
  core::RandomStream random(4, "points");
  for (int k = 0; k < 200; ++k) {
    const glm::dvec2 p(random.uniform(0.2, 5.8), random.uniform(0.2, 3.8));
    double best = std::numeric_limits<double>::infinity();
    for (const DistanceField& field : single) best = std::min(best, field.at(p));
    // Interpolation across the border between two goals' cells may differ a little.
    if (std::isfinite(best)) {
      EXPECT_NEAR(all.at(p), best, 0.03);
    }
  }
}

TEST(DistanceField, UnreachableIsInfinite) {
  TriangleMesh mesh = make_room(6.0F, 4.0F);
  append_box(mesh, {2.9F, 0.0F, 0.0F}, {3.1F, 4.0F, 2.0F});
  const CollisionWorld world(mesh, small_disc());
  const FreeSpace space = make_free_space(world);
  EXPECT_EQ(space.island_at({1, 1}) + space.island_at({5, 1}), 3) << "two islands";
  const DistanceField field(space, std::vector<glm::dvec2>{{1.0, 1.0}});
  EXPECT_TRUE(std::isinf(field.at({5.0, 1.0})));
  EXPECT_TRUE(field.path_from({5.0, 1.0}).empty());
  EXPECT_TRUE(std::isinf(field.at({-3.0, 1.0})));
  EXPECT_TRUE(std::isinf(DistanceField(space, {}).at({1.0, 1.0})));
}

TEST(DistanceField, SnapsFromBesideFreeSpace) {
  const CollisionWorld world(make_room(4.0F, 4.0F), small_disc());
  const FreeSpace space = make_free_space(world);
  const DistanceField field(space, std::vector<glm::dvec2>{{2.0, 2.0}});
  EXPECT_NEAR(field.at({0.03, 2.0}), 1.97, 0.03);
  EXPECT_TRUE(std::isinf(field.at({0.03, 2.0}, 0.02)));
}

}  // namespace
}  // namespace segsim::sim
