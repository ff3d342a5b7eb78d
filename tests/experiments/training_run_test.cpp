#include "experiments/training_run.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <thread>

#include <gmock/gmock.h>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/coverage.h"
#include "renderer/cpu_renderer.h"
#include "renderer/room_scene.h"
#include "renderer/training/heads/panoptic_head.h"
#include "renderer/training/surfel_labels.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

/// A small labelled room seen from a ring of cameras.
class TrainingRunTest : public ::testing::Test {
 protected:
  TrainingRunTest()
      : folder_(fs::temp_directory_path() /
                ("segsim_training_run_" + std::to_string(::getpid()))) {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    start_ = renderer::make_room_scene({.surfel_count = 4000, .seed = 3, .spread = 1.2});
    for (std::uint16_t id = 1; id < renderer::kRoomFirstBoxClass + renderer::kRoomBoxClasses;
         ++id) {
      set_.classes.push_back(
          {id, "class " + std::to_string(id), id >= renderer::kRoomFirstBoxClass});
    }
    set_.intrinsics = core::CameraIntrinsics::from_fov(64, 48, 1.2);
    set_.has_true_labels = true;
    const auto renderer =
        renderer::make_cpu_renderer(std::make_shared<const renderer::SurfelCloud>(start_));
    for (const core::CameraPose& pose : renderer::room_camera_ring(12)) {
      const core::Frame drawn = renderer->render(pose, set_.intrinsics, core::Channels::kAll);
      renderer::TrainingView view;
      view.frame = set_.training.size() + set_.held_out.size();
      view.name = "view " + std::to_string(view.frame);
      view.T_world_camera = pose;
      view.rgb = drawn.rgb;
      view.depth_m = drawn.depth_m;
      renderer::RgbdFrame frame;
      frame.semantic = drawn.semantic;
      frame.instance = drawn.instance;
      view.masks = renderer::exact_masks(frame);
      (view.frame % 4 == 0 ? set_.held_out : set_.training).push_back(std::move(view));
    }
    options_.config.geometry.iterations = 12;
    options_.config.geometry.densify.max_scale_extent = 1.0;
    options_.config.panoptic.iterations = 12;
    options_.config.panoptic.sampling.pixels = 512;
    options_.device.threads = 1;
    options_.preview_every_s = 0.0;
    options_.work = folder_ / "work";
  }
  ~TrainingRunTest() override { fs::remove_all(folder_); }

  fs::path folder_;
  renderer::SurfelCloud start_;
  renderer::TrainingSet set_;
  TrainingOptions options_;
};

void expect_same(const TrainedScene& a, const TrainedScene& b) {
  EXPECT_EQ(a.surfels.position_m, b.surfels.position_m);
  EXPECT_EQ(a.surfels.sh, b.surfels.sh);
  EXPECT_EQ(a.surfels.semantic_id, b.surfels.semantic_id);
  EXPECT_EQ(a.surfels.instance_id, b.surfels.instance_id);
  EXPECT_EQ(a.surfels.instance_feature, b.surfels.instance_feature);
}

TEST_F(TrainingRunTest, KilledAndResumedIsTheSame) {
  // The child first: a fork must not happen beside threads.
  options_.checkpoint_every_s = 1e-9;
  const fs::path mark = options_.work / "head.iteration";
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    (void)train_scene(set_, start_, options_);
    ::_exit(0);
  }
  for (int i = 0; i < 6000 && !fs::exists(mark); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  ::kill(child, SIGKILL);
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(fs::exists(options_.work / "geometry.state"));
  options_.checkpoint_every_s = 0.0;
  options_.resume = true;
  const TrainedScene resumed = train_scene(set_, start_, options_);

  TrainingOptions whole_options = options_;
  whole_options.resume = false;
  whole_options.work = folder_ / "whole";
  const TrainedScene whole = train_scene(set_, start_, whole_options);
  expect_same(resumed, whole);
  ASSERT_TRUE(whole.model.has_value());
  EXPECT_EQ(whole.surfels.semantic_feature.size(), whole.surfels.size());
  EXPECT_TRUE(fs::exists(whole_options.work / "preview.png"));
  EXPECT_THAT(core::read_file(whole_options.work / "losses.csv"),
              ::testing::AllOf(::testing::HasSubstr("geometry,10,"),
                               ::testing::HasSubstr("labels,10,")));

  // Another seed is another run.
  options_.seed = 2;
  EXPECT_THROW((void)train_scene(set_, start_, options_), core::InputError);
  remove_training_state(options_.work);
  EXPECT_FALSE(fs::exists(options_.work / "geometry.state"));
}

TEST_F(TrainingRunTest, EveryHeadLabelsTheSurfels) {
  for (const std::string& head : renderer::panoptic_head_names()) {
    options_.head = head;
    options_.work = folder_ / head;
    options_.config.panoptic.iterations = 200;
    const TrainedScene scene = train_scene(set_, start_, options_);
    EXPECT_TRUE(scene.surfels.has_labels()) << head;
    EXPECT_GT(scene.quality.mean_iou, 0.1) << head;
    EXPECT_GT(scene.quality.color.psnr_db(), 20.0) << head;
    EXPECT_EQ(scene.quality.color.views(), 3) << head;
    EXPECT_FALSE(scene.statistics.empty());
  }
}

TEST_F(TrainingRunTest, WithoutAHeadLiftedLabelsStayIfTheSurfelsDo) {
  options_.head = "none";
  options_.config.geometry.iterations = 0;
  const TrainedScene scene = train_scene(set_, start_, options_);
  EXPECT_EQ(scene.surfels.semantic_id, start_.semantic_id);
  EXPECT_GT(scene.quality.panoptic.pq, 0.9);
}

TEST(SurfelLabels, InstancesTakeTheClassOfMostSurfels) {
  renderer::SurfelCloud surfels;
  for (int i = 0; i < 6; ++i)
    surfels.position_m.emplace_back(static_cast<float>(i), 0.0F, 0.0F);
  surfels.instance_id = {7, 7, 7, 9, 9, 0};
  surfels.semantic_id = {2, 2, 3, 1, 1, 2};
  const std::vector<core::SceneClass> classes{
      {1, "floor", false}, {2, "chair", true}, {3, "couch", true}};
  const auto instances = renderer::instances_of(surfels, classes);
  ASSERT_EQ(instances.size(), 1U);  // 9 is a floor.
  EXPECT_EQ(instances[0].id, 7);
  EXPECT_EQ(instances[0].class_id, 2);
  EXPECT_EQ(instances[0].name, "chair 7");
  EXPECT_NEAR(instances[0].box_max_m.x, 2.0, 1e-6);
}

TEST(Coverage, WarnsOfThinScenes) {
  core::SceneManifest manifest;
  EXPECT_EQ(coverage_warning(manifest), "");
  RobotCoverage coverage;
  coverage.views = 10, coverage.mean_alpha = 0.95, coverage.thin_views = 1;
  manifest.statistics = coverage.listing();
  EXPECT_EQ(coverage_warning(manifest), "");
  coverage.thin_views = 2;
  manifest.statistics = coverage.listing();
  EXPECT_THAT(coverage_warning(manifest), ::testing::HasSubstr("20 %"));
  coverage.thin_views = 0, coverage.mean_alpha = 0.5;
  manifest.statistics = coverage.listing();
  EXPECT_THAT(coverage_warning(manifest), ::testing::HasSubstr("50 %"));
}

}  // namespace
}  // namespace segsim::experiments
