#include "worlds/capture/capture_plan.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <glm/gtc/quaternion.hpp>

#include "core/error.h"
#include "tests/worlds/mesh_fixtures.h"

namespace segsim::worlds {
namespace {

using ::testing::HasSubstr;

/// The box room with a floor that reaches 6 m beyond its wall at x = 2, without a roof there.
sim::MeshScene room_with_terrace() {
  sim::MeshScene scene = box_room();
  add_rectangle(scene, {2, -6, 0}, {6, 0, 0}, {0, 12, 0}, 0, 2, 0);
  return scene;
}

TEST(CapturePlan, CamerasStayInTheRoomAndAwayFromThings) {
  CapturePlan plan;
  plan.heights_m = {1.0, 1.4};
  const std::vector<core::CameraPose> poses = plan_capture_trajectory(box_room(), plan);
  ASSERT_GE(poses.size(), 20U);
  bool near_each_corner[4] = {};
  for (const core::CameraPose& pose : poses) {
    const glm::dvec3& p = pose.translation_m();
    EXPECT_LE(std::max(std::abs(p.x), std::abs(p.y)), 2.0 - plan.clearance_m + plan.cell_m);
    const double dx = std::max({0.75 - p.x, 0.0, p.x - 1.25});
    const double dy = std::max({-0.25 - p.y, 0.0, p.y - 0.25});
    EXPECT_GE(std::hypot(dx, dy), plan.clearance_m - plan.cell_m) << "the chair";
    EXPECT_TRUE(p.z == 1.0 || p.z == 1.4);
    near_each_corner[(p.x > 0 ? 1 : 0) + (p.y > 0 ? 2 : 0)] = true;
  }
  for (const bool covered : near_each_corner) EXPECT_TRUE(covered);
}

TEST(CapturePlan, ViewsLookInManyDirectionsUpright) {
  const std::vector<core::CameraPose> poses = plan_capture_trajectory(box_room());
  std::set<int> octants;
  for (const core::CameraPose& pose : poses) {
    const glm::dvec3 forward = pose.rotation() * glm::dvec3(0, 0, 1);
    const glm::dvec3 right = pose.rotation() * glm::dvec3(1, 0, 0);
    octants.insert(static_cast<int>(std::floor(std::atan2(forward.y, forward.x) / 0.7853982)));
    EXPECT_NEAR(right.z, 0.0, 1e-9) << "no roll";
    EXPECT_LT(std::abs(forward.z), 0.6);
  }
  EXPECT_EQ(octants.size(), 8U);
}

TEST(CapturePlan, ATerraceWithoutARoofIsNotIndoors) {
  // 16 m^2 of room against 72 m^2 of terrace: only the roof speaks for the room.
  sim::MeshScene scene = room_with_terrace();
  add_rectangle(scene, {2, -6, 0}, {6, 0, 0}, {0, 0, 2}, 0, 1, 0);
  CapturePlan plan;
  const std::vector<core::CameraPose> open = plan_capture_trajectory(scene, plan);
  EXPECT_TRUE(std::any_of(open.begin(), open.end(), [](const auto& pose) {
    return pose.translation_m().x > 2;
  })) << "mostly without a roof: the whole is taken as open from above";
  // A roof over more than half of all: the rest is outside.
  add_rectangle(scene, {2, -6, 2.5}, {0, 12, 0}, {3, 0, 0}, 0, 3, 0);
  const std::vector<core::CameraPose> roofed = plan_capture_trajectory(scene, plan);
  ASSERT_FALSE(roofed.empty());
  for (const core::CameraPose& pose : roofed) EXPECT_LT(pose.translation_m().x, 5.1);
}

TEST(CapturePlan, IsDeterministicAndThinsEvenly) {
  CapturePlan plan;
  const auto all = plan_capture_trajectory(box_room(), plan);
  const auto again = plan_capture_trajectory(box_room(), plan);
  ASSERT_EQ(all.size(), again.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_EQ(all[i].translation_m(), again[i].translation_m());
    EXPECT_EQ(all[i].rotation(), again[i].rotation());
  }
  plan.max_views = static_cast<int>(all.size()) / 2;
  EXPECT_EQ(plan_capture_trajectory(box_room(), plan).size(), all.size() / 2);
}

TEST(CapturePlan, ASceneWithoutFloorIsRefused) {
  sim::MeshScene scene;
  scene.materials.resize(1);
  add_rectangle(scene, {-2, -2, 1}, {4, 0, 0}, {0, 4, 0}, 0, 1, 0);
  EXPECT_THROW((void)plan_capture_trajectory(scene), core::InputError);
  EXPECT_THROW((void)plan_capture_trajectory(sim::MeshScene{}), core::InputError);
}

TEST(CapturePlan, AFarVertexIsRefusedBeforeItCostsAnything) {
  for (const glm::vec3& far_m : {glm::vec3(1e6F, 1e6F, 0.0F), glm::vec3(0.0F, 0.0F, 1e6F)}) {
    sim::MeshScene scene = box_room();
    sim::SubMesh& mesh = scene.meshes.front();
    mesh.positions_m[mesh.triangles.front().x] = far_m;
    EXPECT_THROW((void)plan_capture_trajectory(scene, {}), core::InputError);
  }
}

TEST(ReadTrajectory, BothFormats) {
  const TemporaryFolder folder;
  folder.write("t.txt", "# comment\n\n1 2 1.5 1.5707963267948966 0\n0.5 1 2 3 0 0 0 1\r\n");
  const auto poses = read_trajectory(folder.path() / "t.txt");
  ASSERT_EQ(poses.size(), 2U);
  const glm::dvec3 forward = poses[0].rotation() * glm::dvec3(0, 0, 1);
  EXPECT_NEAR(forward.y, 1.0, 1e-9);
  EXPECT_NEAR(poses[0].translation_m().z, 1.5, 1e-12);
  EXPECT_EQ(poses[1].translation_m(), glm::dvec3(1, 2, 3));
  EXPECT_EQ(poses[1].rotation(), glm::dquat(1, 0, 0, 0));
}

TEST(ReadTrajectory, ErrorsNameTheLine) {
  const TemporaryFolder folder;
  const auto message = [&](const std::string& text) -> std::string {
    folder.write("t.txt", text);
    try {
      (void)read_trajectory(folder.path() / "t.txt");
    } catch (const core::InputError& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_THAT(message("1 2 3 4 5\n1 2 3\n"), HasSubstr("t.txt:2: expected 5 numbers"));
  EXPECT_THAT(message("1 2 x 4 5\n"), HasSubstr("t.txt:1: expected numbers, found \"x\""));
  EXPECT_THAT(message("1 2 nan 4 5\n"), HasSubstr("t.txt:1: expected numbers"));
  EXPECT_THAT(message("-1e308 0 1.2 0 0\n"),
              HasSubstr("t.txt:1: expected numbers within 1e+07"));
  EXPECT_EQ(message("1e12 1 2 3 0 0 0 1\n"), "accepted") << "a time of TUM";
  EXPECT_THAT(message("0 1 2 3 0 0 0 2\n"), HasSubstr("t.txt:1: expected a unit quaternion"));
  EXPECT_THAT(message("# nothing\n"), HasSubstr("expected poses"));
}

}  // namespace
}  // namespace segsim::worlds
