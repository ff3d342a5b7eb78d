// Scenes that nothing drives in: their bundle is there all the same.
#include <filesystem>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/bundle_parts.h"
#include "core/file_io.h"
#include "experiments/scenes/reconstruct.h"
#include "experiments/scenes/robot_room.h"
#include "experiments/scenes/viewed_place.h"
#include "renderer/cpu_renderer.h"
#include "tests/error_message.h"
#include "tests/experiments/rendering_only_places.h"
#include "tests/experiments/surfel_recording.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using tests::input_error_of;

const sim::RobotModel& waffle() {
  static const sim::RobotModel robot = sim::RobotModel::by_name("turtlebot3-waffle");
  return robot;
}

class RenderingOnlyTest : public ::testing::Test {
 protected:
  RenderingOnlyTest() {
    options_.name = "place";
    options_.lift.voxel_m = 0.04;
    options_.lift.min_observations = 2;
  }

  core::SceneBundle reconstruct(renderer::SurfelCloud surfels,
                                std::vector<core::CameraPose> poses) {
    const SurfelRecording recording(std::move(surfels), std::move(poses));
    return scenes::reconstruct_bundle(recording, options_, folder_ / "bundle");
  }
  /// Of the bundle; it must be for rendering and labels only.
  [[nodiscard]] core::RenderingOnly why() const {
    return core::load_bundle_parts(folder_ / "bundle").rendering_only.value();
  }
  [[nodiscard]] std::string refusal() const {
    return input_error_of(
        [&] { core::require_drivable(core::load_bundle(folder_ / "bundle")); });
  }

  tests::TemporaryFolder folder_;
  scenes::ReconstructOptions options_;
};

TEST_F(RenderingOnlyTest, WithoutAFloorTheSceneIsWritten) {
  const core::SceneBundle bundle = reconstruct(walls_alone(), wall_views());
  EXPECT_THAT(why().reason, HasSubstr("expected a floor near z = 0"));
  EXPECT_EQ(why().robot, "jackal-gentle");
  EXPECT_FALSE(why().free_disc);
  EXPECT_THAT(why().fitting, IsEmpty());
  EXPECT_FALSE(fs::exists(bundle.folder / "collision.ply"));
  EXPECT_FALSE(fs::exists(bundle.folder / "navmesh.bin"));
  EXPECT_EQ(core::load_bundle_parts(bundle.folder).version, 3);
  // In the recording's own frame.
  EXPECT_EQ(core::load_bundle_parts(bundle.folder).levelling.R_world_source,
            glm::dquat(1.0, 0.0, 0.0, 0.0));
  // It draws what was recorded.
  const scenes::ViewedPlace place = scenes::open_viewed_place(bundle.folder);
  const auto renderer = renderer::make_cpu_renderer(place.scene.surfels);
  const core::Frame frame =
      renderer->render(scenes::recorded_view(place, bundle.folder, 0).T_world_camera,
                       place.cameras->intrinsics, core::Channels::kAll);
  EXPECT_THAT(frame.semantic.pixels(), Contains(kBoxClass));
  EXPECT_FALSE(bundle.manifest.instances.empty());
  // Another robot finds no more, and says what would help.
  EXPECT_THAT(input_error_of([&] { (void)scenes::add_navmesh(bundle, waffle()); }),
              HasSubstr("segsim scene remesh --floor-height"));
}

TEST_F(RenderingOnlyTest, TrainingIsNotLostWithoutAFloor) {
  training::TrainingOptions training;
  training.config.geometry.iterations = 4;
  training.config.panoptic.iterations = 10;
  training.config.panoptic.sampling.pixels = 256;
  training.device.threads = 1;
  training.work = folder_ / "work";
  options_.training = training;
  options_.pictures = folder_ / "pictures.png";
  const core::SceneBundle bundle = reconstruct(walls_alone(), wall_views());
  EXPECT_THAT(why().reason, HasSubstr("expected a floor near z = 0"));
  EXPECT_NE(scenes::load_scene_surfels(bundle).labels, nullptr);
  EXPECT_FALSE(fs::exists(options_.pictures));
  EXPECT_FALSE(fs::exists(training.work / "surfels.ply")) << "the bundle has them now";
}

TEST_F(RenderingOnlyTest, CamerasAreAFloorOnlyWhereItIsKnown) {
  options_.collision.floor_is_known = true;
  options_.robot = waffle();
  const core::SceneBundle bundle = reconstruct(walls_alone(), wall_views());
  EXPECT_THAT(bundle.manifest.collision_mesh.name, Not(IsEmpty()));
}

TEST_F(RenderingOnlyTest, TooNarrowForOneRobotIsOpenedForAnother) {
  const core::SceneBundle bundle = reconstruct(corridor(), corridor_views());
  EXPECT_THAT(why().reason, HasSubstr("no walkable area for jackal-gentle (radius 0.33 m"));
  EXPECT_THAT(why().fitting, ElementsAre("turtlebot3-waffle"));
  ASSERT_TRUE(why().free_disc);
  EXPECT_NEAR(why().free_disc->radius_m, kCorridorHalf_m, 0.07);
  EXPECT_NEAR(why().free_disc->center_m.y, 0.0, 0.07);
  EXPECT_THAT(refusal(),
              HasSubstr("found one for rendering and labels only (no walkable area"));
  EXPECT_THAT(refusal(), HasSubstr("robots that fit: turtlebot3-waffle"));
  EXPECT_THAT(refusal(), Not(HasSubstr("\n")));
  EXPECT_EQ(input_error_of([&] { (void)sim::World::load(bundle, waffle()); }), refusal());

  // A robot that does not fit either changes nothing.
  const std::string before = core::read_file(bundle.folder / "scene.yaml");
  EXPECT_THAT(input_error_of([&] {
                (void)scenes::add_navmesh(bundle, sim::RobotModel::by_name("generic-diff"));
              }),
              HasSubstr("expected room for generic-diff, found no walkable area"));
  EXPECT_EQ(core::read_file(bundle.folder / "scene.yaml"), before);
  EXPECT_FALSE(fs::exists(bundle.folder / "navmesh.bin"));

  const core::SceneBundle opened = scenes::add_navmesh(bundle, waffle());
  EXPECT_EQ(core::load_bundle_parts(opened.folder).version, 2);
  EXPECT_EQ(refusal(), "no error");
  EXPECT_NEAR(opened.manifest.robot_radius_m, waffle().circumscribed_radius_m(), 1e-9);
  EXPECT_GT(sim::World::load(opened, waffle()).free_space().area_m2(1), 1.0);
  EXPECT_THAT(input_error_of([&] { (void)scenes::add_navmesh(opened, waffle()); }),
              HasSubstr("expected a bundle for rendering and labels only"));
}

TEST_F(RenderingOnlyTest, StoppedWhileANavmeshIsAddedItIsAsBefore) {
  const core::SceneBundle bundle = reconstruct(corridor(), corridor_views());
  const std::string before = core::read_file(bundle.folder / "scene.yaml");
  // What is left by whoever stops while navmesh.bin is written, and before the manifest is.
  for (const char* left : {"navmesh.bin.tmp", "navmesh.bin"}) {
    std::ofstream(bundle.folder / left) << "half of it";
    EXPECT_THAT(refusal(), HasSubstr("rendering and labels only")) << left;
    EXPECT_EQ(core::read_file(bundle.folder / "scene.yaml"), before);
  }
  (void)scenes::add_navmesh(core::load_bundle(bundle.folder), waffle());
  EXPECT_EQ(refusal(), "no error");
}

}  // namespace
}  // namespace segsim::experiments
