#include "sim/trial/oracle_way.h"

#include <algorithm>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "sim/ground/triangle_mesh.h"
#include "tests/box_mesh.h"

namespace segsim::sim {
namespace {

/// A room of 8 m x 6 m, divided by a wall with a doorway of this width in the middle.
World room(float gap_m) {
  TriangleMesh mesh;
  append_floor(mesh, -4.2F, -3.2F, 4.2F, 3.2F);
  append_box(mesh, {-4.2F, -3.2F, 0.0F}, {-4.0F, 3.2F, 2.0F});
  append_box(mesh, {4.0F, -3.2F, 0.0F}, {4.2F, 3.2F, 2.0F});
  append_box(mesh, {-4.0F, -3.2F, 0.0F}, {4.0F, -3.0F, 2.0F});
  append_box(mesh, {-4.0F, 3.0F, 0.0F}, {4.0F, 3.2F, 2.0F});
  append_box(mesh, {-0.1F, -3.0F, 0.0F}, {0.1F, -0.5F * gap_m, 2.0F});
  append_box(mesh, {-0.1F, 0.5F * gap_m, 0.0F}, {0.1F, 3.0F, 2.0F});
  return World::from_mesh(std::move(mesh), RobotModel::jackal_gentle());
}

double smallest_room_m(const World& world, const std::vector<glm::dvec2>& way) {
  double smallest_m = 1e9;
  for (std::size_t k = 1; k < way.size(); ++k) {
    for (double t = 0.0; t <= 1.0; t += 0.01) {
      const glm::dvec2 p_m = glm::mix(way[k - 1], way[k], t);
      smallest_m = std::min(smallest_m, world.collision().body_distance_m(p_m));
    }
  }
  return smallest_m;
}

TEST(OracleWay, KeepsAwayFromCornersWhereThereIsRoom) {
  const World world = room(2.0F);
  const double radius_m = world.robot().circumscribed_radius_m();
  const glm::dvec2 start_m(-2.0, -2.0), goal_m(2.0, -2.0);
  const std::vector<glm::dvec2> way =
      OracleWay(world, std::vector<glm::dvec2>{goal_m}).from(start_m);
  ASSERT_GE(way.size(), 3U);
  EXPECT_EQ(way.front(), start_m);
  EXPECT_EQ(way.back(), goal_m);
  // A cell's half diagonal may be missing.
  EXPECT_GE(smallest_room_m(world, way), radius_m + 0.15 - 0.04);
  const std::vector<glm::dvec2> shortest =
      world.distance_to(std::vector<glm::dvec2>{goal_m}).path_from(start_m);
  EXPECT_LT(smallest_room_m(world, shortest), radius_m + 0.06);
}

TEST(OracleWay, GoesThroughANarrowDoorAllTheSame) {
  // The disc has a radius of 0.333 m, so 0.74 m leave it 3.5 cm on each side.
  const World world = room(0.74F);
  const glm::dvec2 start_m(-2.0, -2.0), goal_m(2.0, -2.0);
  const std::vector<glm::dvec2> goals{goal_m};
  const DistanceField field = world.distance_to(goals);
  ASSERT_LT(field.at(start_m), 7.0);
  const std::vector<glm::dvec2> way = OracleWay(world, goals).from(start_m);
  ASSERT_FALSE(way.empty());
  EXPECT_EQ(way.back(), goal_m);
}

TEST(OracleWay, NoWayIsNoWay) {
  const World world = room(0.4F);
  EXPECT_TRUE(
      OracleWay(world, std::vector<glm::dvec2>{{2.0, -2.0}}).from({-2.0, -2.0}).empty());
  EXPECT_TRUE(
      OracleWay(world, std::vector<glm::dvec2>{{9.0, 9.0}}).from({-2.0, -2.0}).empty());
}

}  // namespace
}  // namespace segsim::sim
