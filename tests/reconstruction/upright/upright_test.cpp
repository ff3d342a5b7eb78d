// Up and floor of rooms whose truth is known, in frames that are turned at random.

#include <gtest/gtest.h>
#include <glm/gtc/quaternion.hpp>

#include "reconstruction/upright/floor_evidence.h"
#include "reconstruction/upright/gravity_evidence.h"
#include "tests/reconstruction/ray_room.h"

namespace segsim::reconstruction {
namespace {

using testing::living_room;
using testing::RayRoom;

constexpr double kDegree = std::numbers::pi / 180.0;

core::CameraIntrinsics camera() { return core::CameraIntrinsics::from_fov(64, 48, 1.1); }

glm::dquat random_turn(core::RandomStream& random) {
  return glm::normalize(
      glm::dquat(random.normal(), random.normal(), random.normal(), random.normal()));
}

/// A room as a recording shows it: turned by R.
struct Seen {
  std::vector<SurfaceElement> elements;
  std::vector<core::CameraPose> cameras;
};

Seen look_around(const RayRoom& room, const glm::dquat& R, std::uint64_t seed = 1) {
  core::RandomStream random(seed, "depth noise");
  Seen seen;
  std::vector<SeenPoint> points;
  for (const core::CameraPose& pose : room.cameras) {
    const core::Image<float> depth_m = draw_depth(room, pose, camera(), random);
    const core::CameraPose turned(R * pose.rotation(), R * pose.translation_m());
    for (int y = 0; y < depth_m.height_px(); ++y) {
      for (int x = 0; x < depth_m.width_px(); ++x) {
        if (!(depth_m(x, y) < 6.0F)) continue;
        const core::Point<core::frame::Camera> p{
            camera().back_project({x + 0.5, y + 0.5}, depth_m(x, y))};
        points.push_back({glm::vec3((turned * p).xyz_m), glm::vec3(turned.translation_m())});
      }
    }
    seen.cameras.push_back(turned);
  }
  seen.elements = surface_elements(points);
  return seen;
}

double off_deg(const glm::dvec3& a, const glm::dvec3& b) {
  return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b)) / kDegree;
}

/// The floor of a room that is not turned.
std::optional<FloorEvidence> floor_of(const RayRoom& room) {
  const Seen seen = look_around(room, {1.0, 0.0, 0.0, 0.0});
  std::vector<double> heights_m;
  for (const auto& pose : seen.cameras) heights_m.push_back(pose.translation_m().z);
  return find_floor_evidence(seen.elements, heights_m);
}

/// One storey above another; the upper one has a stairwell.
RayRoom two_storeys(bool walked_below) {
  RayRoom house = living_room();
  house.cameras.clear();
  if (walked_below) house.walk({3.2, 1.2}, {3.6, 3.0}, 1.5, 16);
  std::erase_if(house.rectangles, [](const auto& r) { return r.corner_m.z > 2.5; });
  house.add_slab({0, 0, 2.8}, 5, 2.8);
  house.add_slab({1.5, 2.8, 2.8}, 3.5, 1.2);
  house.add_walls({0, 0, 2.6}, {5, 4, 5.3});
  house.add_slab({0, 0, 5.3}, 5, 4);
  house.walk({1.0, 1.2}, {3.6, 2.0}, 4.3, 20);
  return house;
}

/// A landing with a flight of stairs that goes down from it.
RayRoom landing() {
  RayRoom room;
  room.add_slab({0, 0, 0}, 4, 3);
  room.add({0, 0, 0}, {4, 0, 0}, {0, 0, 2.5});
  room.add({0, 3, 0}, {4, 0, 0}, {0, 0, 2.5});
  room.add({0, 0, 0}, {0, 3, 0}, {0, 0, 2.5});
  room.add_slab({0, 0, 2.5}, 7, 3);
  for (int step = 1; step <= 10; ++step) {
    const double x = 4.0 + 0.27 * (step - 1), z = -0.17 * step;
    room.add_slab({x, 0.9, z}, 0.27, 1.2);
    room.add({x, 0.9, z}, {0, 1.2, 0}, {0, 0, 0.17});
  }
  room.add({4, 0.9, -1.7}, {2.7, 0, 0}, {0, 0, 4.2});
  room.add({4, 2.1, -1.7}, {2.7, 0, 0}, {0, 0, 4.2});
  room.add_slab({6.7, 0.9, -1.7}, 1.2, 1.2);
  room.walk({1.0, 1.4}, {3.4, 1.6}, 1.5, 24);
  return room;
}

struct Case {
  const char* name;
  RayRoom room;
};

std::vector<Case> rooms() {
  return {{"furnished", living_room()},
          {"no floor", living_room({.floor = false})},
          {"no ceiling", living_room({.ceiling = false})},
          {"walls alone", living_room({.floor = false, .ceiling = false, .furniture = false})},
          {"two storeys", two_storeys(true)},
          {"stairs", landing()}};
}

TEST(GravityEvidence, FindsUpInAnyFrame) {
  core::RandomStream random(7, "turns");
  for (const Case& c : rooms()) {
    for (int turn = 0; turn < 3; ++turn) {
      const glm::dquat R = random_turn(random);
      const Seen seen = look_around(c.room, R, 1 + static_cast<std::uint64_t>(turn));
      const auto found = find_gravity(seen.elements, seen.cameras);
      ASSERT_TRUE(found.has_value()) << c.name;
      const double error_deg = off_deg(found->up, R * glm::dvec3(0, 0, 1));
      RecordProperty(c.name, std::to_string(error_deg));
      EXPECT_LT(error_deg, 0.5) << c.name;
      EXPECT_TRUE(found->sure())
          << c.name << ": " << found->level_share << " level, " << found->wall_share
          << " walls, " << found->upright_share << " upright, lead " << found->lead
          << ", spread " << found->spread_rad / kDegree;
      EXPECT_LT(error_deg, 5.0 * found->spread_rad / kDegree + 0.1) << c.name;
    }
  }
}

TEST(GravityEvidence, IsNotSureOfOneWall) {
  RayRoom room;
  room.add({3, -5, -5}, {0, 10, 0}, {0, 0, 10});
  for (int i = 0; i < 10; ++i) {
    const glm::dvec3 eye(0.0, 0.1 * i, 1.5);
    room.cameras.push_back(core::look_at(eye, eye + glm::dvec3(1, 0, 0)));
  }
  const Seen seen = look_around(room, {1.0, 0.0, 0.0, 0.0});
  const auto found = find_gravity(seen.elements, seen.cameras);
  EXPECT_FALSE(found && found->sure());
}

TEST(GravityEvidence, IsNotSureOfCamerasOnTheirSides) {
  RayRoom room = living_room();
  for (core::CameraPose& pose : room.cameras) {
    pose = {pose.rotation() * glm::angleAxis(0.5 * std::numbers::pi, glm::dvec3(0, 0, 1)),
            pose.translation_m()};
  }
  const Seen seen = look_around(room, {1.0, 0.0, 0.0, 0.0});
  const auto found = find_gravity(seen.elements, seen.cameras);
  EXPECT_FALSE(found && found->sure());
}

TEST(GravityEvidence, NeedsCamerasAndSurfaces) {
  const Seen seen = look_around(living_room(), {1.0, 0.0, 0.0, 0.0});
  EXPECT_FALSE(find_gravity(seen.elements, {}).has_value());
  EXPECT_FALSE(find_gravity({}, seen.cameras).has_value());
}

TEST(GravityEvidence, CamerasAloneKnowUpWithinDegrees) {
  core::RandomStream random(9, "turns");
  for (int turn = 0; turn < 5; ++turn) {
    const glm::dquat R = random_turn(random);
    std::vector<core::CameraPose> cameras;
    for (const core::CameraPose& pose : living_room().cameras) {
      cameras.emplace_back(R * pose.rotation(), R * pose.translation_m());
    }
    const auto up = up_of_cameras(cameras);
    ASSERT_TRUE(up.has_value());
    EXPECT_LT(off_deg(*up, R * glm::dvec3(0, 0, 1)), 3.0);
    EXPECT_FALSE(up_of_cameras(std::span(cameras).first(5)).has_value());
  }
}

TEST(FloorEvidence, IsTheLowestLargeSurfaceBelowTheCameras) {
  for (const RayRoom& room :
       {living_room(), living_room({.ceiling = false}), two_storeys(true), landing()}) {
    const auto floor = floor_of(room);
    ASSERT_TRUE(floor.has_value());
    EXPECT_FALSE(floor->guessed);
    EXPECT_NEAR(floor->height_m, 0.0, 0.02);
    EXPECT_GT(floor->area_m2, 3.0);
    EXPECT_GT(floor->camera_share, 0.4);
  }
}

TEST(FloorEvidence, IsNotAStoreyThatWasOnlyLookedDownTo) {
  const auto floor = floor_of(two_storeys(false));
  ASSERT_TRUE(floor.has_value());
  EXPECT_NEAR(floor->height_m, 2.8, 0.02);
}

TEST(FloorEvidence, PointsBelowTheFloorDoNotMatter) {
  RayRoom room = living_room();
  room.add({4.99, 2.5, -1.0}, {0, 0.5, 0}, {0, 0, 1.0});  // A reflection in a glossy floor.
  room.add_slab({4.0, 2.5, -1.0}, 0.5, 0.5);
  std::erase_if(room.rectangles, [](const auto& r) {
    return r.corner_m == glm::dvec3(0) && r.side_m.x == 5.0 && r.other_m.y == 4.0;
  });
  room.add_slab({0, 0, 0}, 5, 2.4);  // Where it is seen, there is no floor.
  room.add_slab({0, 2.4, 0}, 3.8, 1.6);
  const auto floor = floor_of(room);
  ASSERT_TRUE(floor.has_value());
  EXPECT_NEAR(floor->height_m, 0.0, 0.02);
}

TEST(FloorEvidence, ASmallPieceIsEnoughWhereWallsEnd) {
  RayRoom room = living_room({.floor = false});
  room.add_slab({4.0, 3.2, 0}, 0.7, 0.7);  // Less than a quarter of the table.
  room.add_slab({2.4, 0.4, 0.75}, 1.8, 1.6);
  const auto floor = floor_of(room);
  ASSERT_TRUE(floor.has_value());
  EXPECT_FALSE(floor->guessed);
  EXPECT_NEAR(floor->height_m, 0.0, 0.03);
}

TEST(FloorEvidence, IsGuessedFromWallsWhereItWasNotSeen) {
  const auto floor = floor_of(living_room({.floor = false}));
  ASSERT_TRUE(floor.has_value());
  EXPECT_TRUE(floor->guessed);
  EXPECT_NEAR(floor->height_m, 0.0, 0.08);
  EXPECT_GT(floor->wall_share, 0.25);
}

TEST(FloorEvidence, IsUnknownIfCamerasNeverLookedDown) {
  RayRoom room = living_room({.furniture = false});
  room.cameras.clear();
  room.walk({3.2, 1.2}, {3.6, 3.0}, 1.5, 24, -0.9);
  const auto floor = floor_of(room);
  EXPECT_FALSE(floor.has_value()) << floor->height_m << " " << floor->wall_share;
}

}  // namespace
}  // namespace segsim::reconstruction
