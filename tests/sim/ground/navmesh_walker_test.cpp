#include "sim/ground/navmesh_walker.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/random.h"
#include "tests/box_mesh.h"
#include "tests/sim/rooms.h"

namespace segsim::sim {
namespace {

/// A wall of 0.2 m that ends at y = -2.
Navmesh fixture(double radius_m = 0.18) {
  TriangleMesh mesh;
  append_floor(mesh, -5, -5, 5, 5);
  append_box(mesh, {-0.1F, -2.0F, 0.0F}, {0.1F, 5.0F, 2.0F});
  NavmeshSettings settings;
  settings.agent_height_m = 0.88;
  settings.agent_radius_m = radius_m;
  settings.max_climb_m = 0.2;
  return Navmesh::build(mesh, settings);
}

NavmeshWalker at(const Navmesh& navmesh, double x_m, double y_m) {
  auto walker = NavmeshWalker::place(navmesh, {x_m, y_m, 0.0});
  EXPECT_TRUE(walker.has_value());
  return std::move(*walker);
}

TEST(NavmeshWalker, GoesWhereItIsToldOnOpenFloor) {
  const Navmesh navmesh = fixture();
  NavmeshWalker walker = at(navmesh, -3, -3);
  for (const ContactResponse response : {ContactResponse::kStop, ContactResponse::kSlide}) {
    const glm::dvec2 to_m = glm::dvec2(walker.position_m()) + glm::dvec2(0.25, 0.1);
    const NavmeshWalker::Step step = walker.walk(to_m, response);
    EXPECT_NEAR(glm::distance(glm::dvec2(step.position_m), to_m), 0.0, 1e-5);
    EXPECT_FALSE(step.wall_normal.has_value());
    EXPECT_FALSE(step.shortened);
  }
}

/// Erosion by 0.18 m is 4 cells; which cells a wall covers depends on the side, so the notes
/// have the edges at -0.30 m and +0.35 m.
TEST(NavmeshWalker, StopsAtTheEdgesOfTheNotes) {
  const Navmesh navmesh = fixture();
  NavmeshWalker left = at(navmesh, -1, 3);
  const NavmeshWalker::Step step = left.walk({1.0, 3.0}, ContactResponse::kStop);
  EXPECT_NEAR(step.position_m.x, -0.30, 0.051);
  EXPECT_NEAR(step.position_m.y, 3.0, 1e-4);
  EXPECT_TRUE(step.shortened);
  ASSERT_TRUE(step.wall_normal.has_value());
  EXPECT_NEAR(glm::distance(*step.wall_normal, glm::dvec2(-1.0, 0.0)), 0.0, 1e-3);
  NavmeshWalker right = at(navmesh, 1, 3);
  EXPECT_NEAR(right.walk({-1.0, 3.0}, ContactResponse::kStop).position_m.x, 0.35, 0.051);
}

TEST(NavmeshWalker, StopsOrSlidesAtASlant) {
  const Navmesh navmesh = fixture();
  NavmeshWalker stopping = at(navmesh, -1, 3);
  const NavmeshWalker::Step stopped = stopping.walk({1.0, 1.0}, ContactResponse::kStop);
  // On the straight way, as far as the edge.
  EXPECT_NEAR(stopped.position_m.x + 1.0, 3.0 - stopped.position_m.y, 1e-4);
  EXPECT_NEAR(stopped.position_m.x, -0.30, 0.051);
  NavmeshWalker sliding = at(navmesh, -1, 3);
  const NavmeshWalker::Step slid = sliding.walk({1.0, 1.0}, ContactResponse::kSlide);
  EXPECT_NEAR(slid.position_m.x, -0.30, 0.051);
  EXPECT_NEAR(slid.position_m.y, 1.0, 0.02) << "the wall takes only the motion across it";
  ASSERT_TRUE(slid.wall_normal.has_value());
  EXPECT_LT(slid.wall_normal->x, -0.9);
  // Away from the wall nothing is in the way.
  EXPECT_FALSE(sliding.walk({-1.0, 1.0}, ContactResponse::kSlide).wall_normal.has_value());
}

/// Habitat's step on a pose. @return  Whether it collided in Habitat's sense.
bool teleport_forward(NavmeshWalker& walker, core::Pose2& pose, double forward_m,
                      ContactResponse response) {
  const NavmeshWalker::Step step = walker.walk({pose.x_m + forward_m * std::cos(pose.yaw_rad),
                                                pose.y_m + forward_m * std::sin(pose.yaw_rad)},
                                               response);
  pose.x_m = step.position_m.x;
  pose.y_m = step.position_m.y;
  return step.shortened;
}

/// 4000 of Habitat's steps: never into the wall, never off the mesh, never to the other side
/// but around its end.
TEST(NavmeshWalker, TeleportStepsNeverLeaveTheMesh) {
  const Navmesh navmesh = fixture();
  core::RandomStream random(11, "navmesh_walker_test");
  int collided = 0;
  for (const ContactResponse response : {ContactResponse::kStop, ContactResponse::kSlide}) {
    NavmeshWalker walker = at(navmesh, -2, 2);
    core::Pose2 pose{walker.position_m().x, walker.position_m().y, 0.0};
    for (int k = 0; k < 2000; ++k) {
      const core::Pose2 before = pose;
      if (random.chance(0.3)) pose.yaw_rad += random.chance(0.5) ? 0.5236 : -0.5236;
      collided += teleport_forward(walker, pose, 0.25, response) ? 1 : 0;
      ASSERT_LE(std::hypot(pose.x_m - before.x_m, pose.y_m - before.y_m), 0.25 + 1e-4);
      const auto nearest = navmesh.nearest({pose.x_m, pose.y_m, 0.0}, 0.1);
      ASSERT_TRUE(nearest.has_value()) << "step " << k;
      ASSERT_NEAR(nearest->position_m.x, pose.x_m, 2e-3) << "step " << k;
      ASSERT_NEAR(nearest->position_m.y, pose.y_m, 2e-3) << "step " << k;
      if (pose.y_m > -2.0) {
        ASSERT_GT(std::abs(pose.x_m), 0.2) << "step " << k;
        if (before.y_m > -2.0) {
          ASSERT_GT(pose.x_m * before.x_m, 0.0) << "step " << k;
        }
      }
    }
  }
  EXPECT_GT(collided, 50);
  EXPECT_LT(collided, 3500);
}

TEST(NavmeshWalker, APlaceFarFromTheMeshIsNone) {
  const Navmesh navmesh = fixture();
  EXPECT_FALSE(NavmeshWalker::place(navmesh, {9.0, 0.0, 0.0}).has_value());
  // Habitat snaps within a box of 2 m.
  EXPECT_TRUE(NavmeshWalker::place(navmesh, {6.0, 0.0, 0.0}).has_value());
}

}  // namespace
}  // namespace segsim::sim
