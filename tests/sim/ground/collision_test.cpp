#include "sim/ground/collision.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/random.h"
#include "tests/box_mesh.h"
#include "tests/sim/rooms.h"

namespace segsim::sim {
namespace {

constexpr double kHalfLength_m = 0.254, kHalfWidth_m = 0.215;

class CollisionInRoom : public testing::Test {
 protected:
  RobotModel robot_ = RobotModel::jackal();
  CollisionWorld world_{make_room(4.0F, 4.0F), robot_};
};

TEST_F(CollisionInRoom, ClearanceIsTheGapToTheWall) {
  const Clearance c = world_.clearance({4.0 - kHalfLength_m - 0.05, 2.0, 0.0});
  EXPECT_NEAR(c.distance_m, 0.05, 1e-6);
  EXPECT_NEAR(c.normal.x, -1.0, 1e-9);
  EXPECT_NEAR(c.point_m.x, 4.0, 1e-6);
  EXPECT_DOUBLE_EQ(world_.clearance({2.0, 2.0, 0.7}).distance_m, CollisionWorld::kReach_m);
  EXPECT_TRUE(world_.collides({3.9, 2.0, 0.0}));
  EXPECT_TRUE(world_.collides({-5.0, 2.0, 0.0})) << "off the grid";
}

TEST_F(CollisionInRoom, ClearanceOfTurnedBaseMatchesItsCorners) {
  core::RandomStream random(1, "yaw");
  for (int k = 0; k < 50; ++k) {
    const double yaw = random.uniform(-3.1, 3.1);
    const double reach_m =
        kHalfLength_m * std::abs(std::cos(yaw)) + kHalfWidth_m * std::abs(std::sin(yaw));
    const Clearance c = world_.clearance({4.0 - reach_m - 0.03, 2.0, yaw});
    EXPECT_NEAR(c.distance_m, 0.03, 1e-6) << yaw;
  }
}

/// From a point to the segment a-b.
double to_segment_m(const glm::dvec2& p, const glm::dvec2& a, const glm::dvec2& b) {
  const double t = glm::clamp(glm::dot(p - a, b - a) / glm::dot(b - a, b - a), 0.0, 1.0);
  return glm::distance(p, a + t * (b - a));
}

/// Two disjoint convex polygons are nearest where one of them has a corner.
double polygon_gap_m(const std::array<glm::dvec2, 4>& p, const std::array<glm::dvec2, 4>& q) {
  double best_m = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t k = 0; k < 4; ++k) {
      best_m = std::min({best_m, to_segment_m(p[i], q[k], q[(k + 1) % 4]),
                         to_segment_m(q[i], p[k], p[(k + 1) % 4])});
    }
  }
  return best_m;
}

std::array<glm::dvec2, 4> rectangle(const core::Pose2& pose, double length_m, double width_m) {
  const glm::dvec2 x(std::cos(pose.yaw_rad), std::sin(pose.yaw_rad)), y(-x.y, x.x);
  const glm::dvec2 c(pose.x_m, pose.y_m);
  const glm::dvec2 a = 0.5 * length_m * x, b = 0.5 * width_m * y;
  return {c + a + b, c - a + b, c - a - b, c + a - b};
}

TEST_F(CollisionInRoom, ClearanceIsThatToTheNearestOfAllCells) {
  TriangleMesh mesh = make_two_rooms();
  append_box(mesh, {1.0F, 0.8F, 0.0F}, {1.3F, 1.2F, 0.5F});
  const RobotModel robot = RobotModel::jackal();
  const CollisionWorld world(mesh, robot);
  const GridFrame& frame = world.frame();
  core::RandomStream random(4, "clearance");
  int compared = 0;
  for (int k = 0; k < 400; ++k) {
    const core::Pose2 pose{random.uniform(0.0, 6.0), random.uniform(0.0, 4.0),
                           random.uniform(-3.0, 3.0)};
    const double found_m = world.clearance(pose).distance_m;
    if (found_m <= 0.0 || found_m >= CollisionWorld::kReach_m) continue;
    const auto base = rectangle(pose, robot.length_m, robot.width_m);
    double nearest_m = std::numeric_limits<double>::infinity();
    for (int j = 0; j < frame.height; ++j) {
      for (int i = 0; i < frame.width; ++i) {
        if (world.body_layer().occupied(i, j) == 0) continue;
        const glm::dvec2 c = frame.center_m(i, j);
        if (glm::distance(c, {pose.x_m, pose.y_m}) > 1.0) continue;
        nearest_m = std::min(
            nearest_m, polygon_gap_m(base, rectangle({c.x, c.y, 0.0}, CollisionWorld::kCell_m,
                                                     CollisionWorld::kCell_m)));
      }
    }
    ASSERT_NEAR(found_m, nearest_m, 1e-9) << "pose " << k;
    ++compared;
  }
  EXPECT_GT(compared, 30);
}

TEST_F(CollisionInRoom, StraightDriveStopsWithinAMillimetreOfTheWall) {
  core::Pose2 pose{2.0, 2.0, 0.0};
  bool contact = false;
  for (int k = 0; k < 400 && !contact; ++k) {
    const MoveResult moved = world_.move(pose, {2.0, 0.0}, 0.005);
    pose = moved.pose;
    contact = moved.contact.has_value();
    if (contact) {
      EXPECT_NEAR(moved.contact->approach_mps, 2.0, 1e-9);
    }
  }
  ASSERT_TRUE(contact);
  const double gap_m = 4.0 - (pose.x_m + kHalfLength_m);
  EXPECT_GT(gap_m, 0.0);
  EXPECT_LT(gap_m, 0.001);
}

TEST_F(CollisionInRoom, NothingIsTunnelledInOneLongStep) {
  const MoveResult moved = world_.move({2.0, 2.0, 0.3}, {2.0, 0.0}, 10.0);
  ASSERT_TRUE(moved.contact.has_value());
  EXPECT_FALSE(world_.collides(moved.pose));
  EXPECT_LT(world_.clearance(moved.pose).distance_m, 0.001);
}

TEST_F(CollisionInRoom, TurningRectangleHitsWhereADiscDoesNot) {
  // Beside the wall, parallel to it, 0.02 m apart: the corners reach 0.118 m farther out.
  const core::Pose2 pose{2.0, 4.0 - kHalfWidth_m - 0.02, 0.0};
  ASSERT_FALSE(world_.collides(pose));
  const MoveResult moved = world_.move(pose, {0.0, 1.0}, 1.0);
  ASSERT_TRUE(moved.contact.has_value());
  EXPECT_GT(moved.pose.yaw_rad, 0.0);
  EXPECT_NEAR(moved.contact->normal.y, -1.0, 1e-9);
  EXPECT_DOUBLE_EQ(moved.contact->approach_mps, 0.0);
  // A point or disc robot stays where it is when it turns.
  EXPECT_GT(world_.body_distance_m({pose.x_m, pose.y_m}), kHalfWidth_m);
  // The corner at angle a = atan(w/l) is at hypot(l, w) sin(yaw + a): first contact in closed
  // form.
  const double a = std::atan2(kHalfWidth_m, kHalfLength_m);
  const double expected =
      std::asin((kHalfWidth_m + 0.02) / std::hypot(kHalfLength_m, kHalfWidth_m)) - a;
  EXPECT_NEAR(moved.pose.yaw_rad, expected, 0.004);
}

TEST_F(CollisionInRoom, ARobotInContactCanLeaveAndCanNotPush) {
  core::Pose2 pose = world_.move({3.0, 2.0, 0.0}, {1.0, 0.0}, 2.0).pose;
  const core::Pose2 at_wall = pose;
  for (int k = 0; k < 100; ++k) pose = world_.move(pose, {1.0, 0.0}, 0.005).pose;
  EXPECT_NEAR(pose.x_m, at_wall.x_m, 0.0006);
  EXPECT_FALSE(world_.collides(pose));
  const MoveResult back = world_.move(pose, {-1.0, 0.0}, 0.2);
  EXPECT_FALSE(back.contact.has_value());
  EXPECT_NEAR(back.pose.x_m, pose.x_m - 0.2, 1e-9);
}

TEST_F(CollisionInRoom, SlidingKeepsTheTangentialPart) {
  // Towards the wall at 30 degrees to it.
  const core::Pose2 start{2.0, 3.5, std::numbers::pi / 6};
  const MoveResult stopped = world_.move(start, {1.0, 0.0}, 1.0, ContactResponse::kStop);
  const MoveResult slid = world_.move(start, {1.0, 0.0}, 1.0, ContactResponse::kSlide);
  ASSERT_TRUE(stopped.contact.has_value());
  ASSERT_TRUE(slid.contact.has_value());
  EXPECT_NEAR(slid.pose.x_m, 2.0 + std::cos(std::numbers::pi / 6), 0.002);
  EXPECT_NEAR(slid.pose.y_m, stopped.pose.y_m, 0.001);
  EXPECT_FALSE(world_.collides(slid.pose));
}

TEST_F(CollisionInRoom, RandomDrivesNeverOverlap) {
  core::RandomStream random(3, "drives");
  core::Pose2 pose{2.0, 2.0, 0.0};
  int contacts = 0;
  for (int k = 0; k < 2000; ++k) {
    const core::VelocityCommand v{random.uniform(-2, 2), random.uniform(-4, 4)};
    const auto response = k % 2 == 0 ? ContactResponse::kStop : ContactResponse::kSlide;
    const MoveResult moved = world_.move(pose, v, 0.1, response);
    pose = moved.pose;
    contacts += moved.contact.has_value() ? 1 : 0;
    ASSERT_FALSE(world_.collides(pose)) << k;
    // Independent of the grid: all corners within the walls.
    for (const double sx : {-1.0, 1.0}) {
      for (const double sy : {-1.0, 1.0}) {
        const double x = sx * kHalfLength_m;
        const double y = sy * kHalfWidth_m;
        const double wx = pose.x_m + std::cos(pose.yaw_rad) * x - std::sin(pose.yaw_rad) * y;
        const double wy = pose.y_m + std::sin(pose.yaw_rad) * x + std::cos(pose.yaw_rad) * y;
        ASSERT_TRUE(wx > 0.0 && wx < 4.0 && wy > 0.0 && wy < 4.0) << k;
      }
    }
  }
  EXPECT_GT(contacts, 10);
}

TEST(Collision, EdgeOfTheFloorIsAnObstacle) {
  TriangleMesh mesh;
  append_floor(mesh, 0, 0, 3, 3);
  const CollisionWorld world(mesh, RobotModel::jackal());
  const MoveResult moved = world.move({1.5, 1.5, 0.0}, {1.0, 0.0}, 5.0);
  ASSERT_TRUE(moved.contact.has_value());
  EXPECT_NEAR(moved.pose.x_m + kHalfLength_m, 3.0, 0.001);
}

TEST(Collision, TableTopMeetsOnlyTheMast) {
  TriangleMesh mesh = make_room(4.0F, 4.0F);
  append_box(mesh, {2.0F, 0.0F, 0.7F}, {4.0F, 4.0F, 0.75F});
  RobotModel robot = RobotModel::jackal();
  const MoveResult with_mast =
      CollisionWorld(mesh, robot).move({1.0, 2.0, 0.0}, {1.0, 0.0}, 2.0);
  ASSERT_TRUE(with_mast.contact.has_value());
  EXPECT_NEAR(with_mast.pose.x_m + robot.mast_radius_m, 2.0, 0.001);
  robot.mast_height_m = 0.0;
  EXPECT_FALSE(
      CollisionWorld(mesh, robot).move({1.0, 2.0, 0.0}, {1.0, 0.0}, 2.0).contact.has_value());
}

TEST(Collision, RefusesAMeshWithoutFloor) {
  TriangleMesh mesh;
  EXPECT_THROW(CollisionWorld(mesh, RobotModel::jackal()), core::InputError);
  append_floor(mesh, 0, 0, 1, 1, 0.5F);
  EXPECT_THROW(CollisionWorld(mesh, RobotModel::jackal()), core::InputError);
}

}  // namespace
}  // namespace segsim::sim
