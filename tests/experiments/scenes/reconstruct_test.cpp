#include "experiments/scenes/reconstruct.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/bundle_parts.h"
#include "experiments/scenes/scene_surfels.h"
#include "renderer/cpu_renderer.h"
#include "renderer/scene/surfel_transform.h"
#include "sim/ground/world.h"
#include "tests/experiments/surfel_recording.h"
#include "tests/experiments/surfel_room.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using ::testing::StartsWith;

/// The surfel room, moved.
class RoomRecording : public SurfelRecording {
 public:
  RoomRecording(const glm::dquat& R, const glm::dvec3& t_m)
      : SurfelRecording(moved_room(R, t_m), moved_views(R, t_m)) {}

 private:
  static renderer::SurfelCloud moved_room(const glm::dquat& R, const glm::dvec3& t_m) {
    renderer::SurfelCloud surfels = surfel_room();
    renderer::transform_surfels(R, t_m, surfels);
    return surfels;
  }
  static std::vector<core::CameraPose> moved_views(const glm::dquat& R,
                                                   const glm::dvec3& t_m) {
    std::vector<core::CameraPose> poses = room_views(12);
    const core::Transform<core::frame::World, core::frame::World> T_moved_room(R, t_m);
    for (core::CameraPose& pose : poses) pose = T_moved_room * pose;
    return poses;
  }
};

class ReconstructTest : public ::testing::Test {
 protected:
  ReconstructTest()
      : folder_(fs::temp_directory_path() /
                ("segsim_reconstruct_" + std::to_string(::getpid()))) {
    fs::remove_all(folder_);
    options_.name = "room";
    options_.lift.voxel_m = 0.04;
    options_.lift.min_observations = 2;
    training::TrainingOptions training;
    training.config.geometry.iterations = 4;
    training.config.panoptic.iterations = 30;
    training.config.panoptic.sampling.pixels = 512;
    training.device.threads = 1;
    training.work = folder_ / "work";
    options_.training = training;
  }
  ~ReconstructTest() override { fs::remove_all(folder_); }

  fs::path folder_;
  scenes::ReconstructOptions options_;
};

double statistic(const core::SceneManifest& manifest, const std::string& name) {
  for (const auto& [key, value] : manifest.statistics) {
    if (key == name) return value;
  }
  return std::nan("");
}

TEST_F(ReconstructTest, TrainedBundleIsLevelledAndKeepsItsLabels) {
  const glm::dquat R = glm::angleAxis(0.02, glm::dvec3(0.0, 1.0, 0.0));
  const glm::dvec3 t_m(0.0, 0.0, 0.05);
  const core::SceneBundle bundle =
      scenes::reconstruct_bundle(RoomRecording(R, t_m), options_, folder_ / "bundle");
  const core::BundleParts parts = core::load_bundle_parts(bundle.folder);
  EXPECT_EQ(parts.version, 2);
  EXPECT_THAT(parts.mesh_source, StartsWith("fused depth of"));
  EXPECT_EQ(statistic(bundle.manifest, "levelled"), 1.0);
  // The cameras went along.
  const RoomRecording recording(R, t_m);
  const core::CameraPath cameras = core::read_camera_path(bundle.folder / parts.cameras.name);
  ASSERT_EQ(cameras.views.size(), recording.frame_count() - 5);  // Those held out.
  EXPECT_EQ(cameras.views[2].frame, recording.frame_name(3));
  const glm::dvec3 place_m =
      parts.levelling.R_world_source * recording.pose(3).translation_m() +
      parts.levelling.p_world_source_m;
  EXPECT_LT(glm::distance(cameras.views[2].T_world_camera.translation_m(), place_m), 1e-9);
  EXPECT_LT(std::abs(statistic(bundle.manifest, "floor_height_m")), 0.01);
  EXPECT_LT(statistic(bundle.manifest, "floor_tilt_rad"), 0.0035);
  // The true floor, through both transforms.
  for (const glm::dvec3& corner : {glm::dvec3(-2, -1.5, 0), {2, 1.5, 0}, {2, -1.5, 0}}) {
    const glm::dvec3 p =
        parts.levelling.R_world_source * (R * corner + t_m) + parts.levelling.p_world_source_m;
    EXPECT_NEAR(p.z, 0.0, 0.015);
  }

  // The surfels went along: their floor is at z = 0 as well.
  const scenes::SceneSurfels scene = scenes::load_scene_surfels(bundle);
  ASSERT_NE(scene.labels, nullptr);
  EXPECT_EQ(scene.labels->size(), scene.surfels->size());
  std::vector<float> heights;
  for (const glm::vec3& p : scene.surfels->position_m) {
    if (p.x < 1.0F && std::abs(p.y) < 1.4F && p.z < 0.3F && p.x > -1.9F)
      heights.push_back(p.z);
  }
  ASSERT_GT(heights.size(), 500U);
  std::nth_element(heights.begin(),
                   heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2),
                   heights.end());
  EXPECT_NEAR(heights[heights.size() / 2], 0.0F, 0.02F);
  // A robot has room, and the box has a place in the levelled world.
  const sim::World world = sim::World::load(bundle, options_.robot);
  EXPECT_GT(world.free_space().area_m2(), 3.0);
  ASSERT_FALSE(bundle.manifest.instances.empty());
  for (const core::SceneInstance& instance : bundle.manifest.instances) {
    EXPECT_LT(instance.box_max_m.z, 2.5);
    EXPECT_GT(instance.box_min_m.z, -0.1);
  }
  // Labels from the file draw what labels from memory drew: something.
  const auto renderer = renderer::make_cpu_renderer(scene.surfels, {}, scene.labels);
  const core::Frame frame =
      renderer->render(core::look_at({-1, 0, 1.2}, {1.6, 1.1, 0.4}),
                       core::CameraIntrinsics::from_fov(64, 48, 1.4), core::Channels::kAll);
  EXPECT_GT(std::count_if(frame.semantic.pixels().begin(), frame.semantic.pixels().end(),
                          [](std::uint16_t id) { return id != 0; }),
            2000);
}

TEST_F(ReconstructTest, LiftedBundleHasIdsAlone) {
  options_.training.reset();
  const core::SceneBundle bundle = scenes::reconstruct_bundle(RoomRecording({1, 0, 0, 0}, {}),
                                                              options_, folder_ / "bundle");
  const core::BundleParts parts = core::load_bundle_parts(bundle.folder);
  EXPECT_EQ(parts.mesh_source, "lifted points");
  EXPECT_TRUE(parts.labels.name.empty());
  EXPECT_EQ(parts.levelling.p_world_source_m, glm::dvec3(0.0));
  EXPECT_EQ(scenes::load_scene_surfels(bundle).labels, nullptr);
}

TEST_F(ReconstructTest, SourceOfTheMeshCanBeChosen) {
  options_.training.reset();
  options_.mesh = scenes::MeshSource::kDepth;
  const core::SceneBundle bundle = scenes::reconstruct_bundle(RoomRecording({1, 0, 0, 0}, {}),
                                                              options_, folder_ / "bundle");
  EXPECT_THAT(core::load_bundle_parts(bundle.folder).mesh_source,
              StartsWith("fused depth of 36"));
}

}  // namespace
}  // namespace segsim::experiments
