#include "sim/ground/world.h"

#include <fstream>

#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "tests/sim/rooms.h"
#include "worlds/surface/bundle_files.h"

namespace segsim::sim {
namespace {

class WorldFromBundle : public testing::Test {
 protected:
  std::filesystem::path folder_ =
      std::filesystem::path(testing::TempDir()) / "segsim_world_test";
  void SetUp() override {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    core::SceneManifest manifest;
    manifest.name = "two rooms";
    manifest.created_by = "test";
    manifest.source = "test";
    manifest.origin = {49.9, 8.9, 0.0, 0.0};
    manifest.camera_height_m = 1.2;
    manifest.classes = {{4, "couch", true}};
    worlds::write_collision_files(folder_, make_two_rooms(), robot_, manifest);
    EXPECT_NEAR(manifest.robot_radius_m, 0.333, 0.001);
    manifest.surfels.name = "surfels.ply";
    std::ofstream(folder_ / "surfels.ply") << "not read here";
    core::write_bundle_manifest(folder_, manifest);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  RobotModel robot_ = RobotModel::jackal();
};

TEST_F(WorldFromBundle, EqualsTheWorldFromTheMesh) {
  const World loaded = World::load(core::load_bundle(folder_), robot_);
  const World direct = World::from_mesh(make_two_rooms(), robot_);
  EXPECT_EQ(loaded.manifest().name, "two rooms");
  EXPECT_EQ(loaded.free_space().free.pixels(), direct.free_space().free.pixels());
  EXPECT_EQ(loaded.navmesh().island_areas_m2(), direct.navmesh().island_areas_m2());
  EXPECT_NEAR(loaded.local_frame().to_geodetic({10, 20, 0}).latitude_deg, 49.9001798121, 1e-9);
  const std::vector<glm::dvec2> goals = {{5.0, 1.0}};
  EXPECT_EQ(loaded.distance_to(goals).at({1, 1}), direct.distance_to(goals).at({1, 1}));
}

TEST_F(WorldFromBundle, NavmeshAndGridAgree) {
  const World world = World::load(core::load_bundle(folder_), robot_);
  const std::vector<glm::dvec2> goals = {{5.0, 1.0}};
  const DistanceField field = world.distance_to(goals);
  core::RandomStream random(3, "pairs");
  int compared = 0;
  for (int k = 0; k < 200; ++k) {
    const glm::dvec3 p = world.navmesh().random_point(random);
    const auto path = world.navmesh().find_path(p, {5.0, 1.0, 0.0});
    const double grid_m = field.at({p.x, p.y});
    if (!path || grid_m < 1.0) continue;
    ++compared;
    EXPECT_NEAR(path->length_m / grid_m, 1.0, 0.06) << p.x << ", " << p.y;
  }
  EXPECT_GT(compared, 100);
}

TEST_F(WorldFromBundle, StaysValidWhenMoved) {
  World world = World::load(core::load_bundle(folder_), robot_);
  const std::vector<glm::dvec2> goals = {{5.0, 1.0}};
  const DistanceField field = world.distance_to(goals);
  const double before_m = field.at({1.0, 1.0});
  const World moved = std::move(world);
  EXPECT_EQ(field.at({1.0, 1.0}), before_m);
  EXPECT_EQ(&field.space(), &moved.free_space());
}

TEST_F(WorldFromBundle, AnotherRobotGetsItsOwnNavmesh) {
  RobotModel small = robot_;
  small.length_m = small.width_m = 0.3;
  const World world = World::load(core::load_bundle(folder_), small);
  EXPECT_NEAR(world.navmesh().settings().agent_radius_m, 0.212, 0.001);
}

TEST(World, NoRoomForTheRobotIsAnError) {
  TriangleMesh mesh = make_room(0.5F, 0.5F);
  EXPECT_THROW((void)World::from_mesh(mesh, RobotModel::jackal()), core::InputError);
}

}  // namespace
}  // namespace segsim::sim
