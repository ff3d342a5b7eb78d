#include "experiments/training/training_run.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <new>
#include <thread>

#include <gmock/gmock.h>

#include "core/error.h"
#include "core/file_io.h"
#include "core/interrupted.h"
#include "experiments/scenes/coverage.h"
#include "experiments/scenes/reconstruct.h"
#include "experiments/scenes/viewed_place.h"
#include "experiments/support/stop_signal.h"
#include "experiments/training/training_folder.h"
#include "reconstruction/labels/panoptic_head.h"
#include "reconstruction/training/surfel_labels.h"
#include "reconstruction/training/training_memory.h"
#include "renderer/cpu_renderer.h"
#include "renderer/scene/room_scene.h"
#include "tests/error_message.h"

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
      reconstruction::TrainingView view;
      view.frame = set_.training.size() + set_.held_out.size();
      view.name = "view " + std::to_string(view.frame);
      view.T_world_camera = pose;
      view.rgb = drawn.rgb;
      view.depth_m = drawn.depth_m;
      reconstruction::RgbdFrame frame;
      frame.semantic = drawn.semantic;
      frame.instance = drawn.instance;
      view.masks = reconstruction::exact_masks(frame);
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

  /// Leaves a state after 5 of 12 iterations, as a kill would.
  void half_of_geometry() {
    options_.work = folder_ / "work";
    fs::create_directories(options_.work);
    reconstruction::GeometryTrainer trainer(set_, start_, options_.config.geometry,
                                            options_.seed, options_.device);
    while (trainer.iteration() < 5) (void)trainer.step();
    trainer.save(options_.work / "geometry.state",
                 training::training_identity(options_, set_, start_));
  }

  fs::path folder_;
  renderer::SurfelCloud start_;
  reconstruction::TrainingSet set_;
  training::TrainingOptions options_;
};

void expect_same(const training::TrainedScene& a, const training::TrainedScene& b) {
  EXPECT_EQ(a.surfels.position_m, b.surfels.position_m);
  EXPECT_EQ(a.surfels.sh, b.surfels.sh);
  EXPECT_EQ(a.surfels.semantic_id, b.surfels.semantic_id);
  EXPECT_EQ(a.surfels.instance_id, b.surfels.instance_id);
  EXPECT_EQ(a.surfels.instance_feature, b.surfels.instance_feature);
}

/// A signal while the shape, and one while the labels are trained.
TEST_F(TrainingRunTest, StoppedAndResumedIsTheSame) {
  options_.checkpoint_every_s = 1e-9;  // Files tell how far it is.
  options_.resume = true;
  for (const char* state : {"geometry.state", "head.iteration"}) {
    const support::StopOnSignal signals;
    std::jthread watch([&](const std::stop_token& ended) {
      while (!ended.stop_requested() && !fs::exists(options_.work / state)) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      support::StopOnSignal::request();
    });
    EXPECT_THROW((void)training::train_scene(set_, start_, options_), core::Interrupted);
    EXPECT_TRUE(fs::exists(options_.work / "geometry.state"));
  }
  const training::TrainedScene resumed = training::train_scene(set_, start_, options_);
  options_.work = folder_ / "whole";
  expect_same(resumed, training::train_scene(set_, start_, options_));
}

TEST_F(TrainingRunTest, LabelsAndSurfelsTogetherCanBeStoppedAndResumed) {
  options_.joint = true;
  options_.config.panoptic.iterations = 40;
  options_.checkpoint_every_s = 1e-9;
  options_.resume = true;
  {
    const support::StopOnSignal signals;
    std::jthread watch([&](const std::stop_token& ended) {
      while (!ended.stop_requested() && !fs::exists(options_.work / "head.iteration")) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      support::StopOnSignal::request();
    });
    EXPECT_THROW((void)training::train_scene(set_, start_, options_), core::Interrupted);
    EXPECT_TRUE(fs::exists(options_.work / "joint.state"));
  }
  const training::TrainedScene resumed = training::train_scene(set_, start_, options_);
  options_.work = folder_ / "whole";
  expect_same(resumed, training::train_scene(set_, start_, options_));
  options_.joint = false;
  options_.work = folder_ / "frozen";
  const training::TrainedScene frozen = training::train_scene(set_, start_, options_);
  ASSERT_EQ(frozen.surfels.size(), resumed.surfels.size());
  EXPECT_NE(frozen.surfels.position_m, resumed.surfels.position_m);
}

TEST_F(TrainingRunTest, WhatCannotTrainTogetherIsRefusedBeforeTheWork) {
  options_.joint = true;
  options_.head = "pvlff";
  EXPECT_THAT(
      tests::input_error_of([&] { (void)training::train_scene(set_, start_, options_); }),
      "training labels and surfels together (joint): expected a head of queries: query | "
      "panoptic-splatting | panoptic-recon++, found \"pvlff\"");
  options_.head = "query";
  options_.config.panoptic.sampling.max_surfels_per_pixel = 4;
  EXPECT_THAT(
      tests::input_error_of([&] { (void)training::train_scene(set_, start_, options_); }),
      ::testing::HasSubstr("max_surfels_per_pixel: 0"));
  EXPECT_FALSE(fs::exists(options_.work / "geometry.state"));
}

TEST_F(TrainingRunTest, KilledAndResumedIsTheSame) {
  // The child first: a fork must not happen beside threads.
  options_.checkpoint_every_s = 1e-9;
  const fs::path mark = options_.work / "head.iteration";
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    (void)training::train_scene(set_, start_, options_);
    ::_exit(0);
  }
  for (int i = 0; i < 6000 && !fs::exists(mark); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  ::kill(child, SIGKILL);
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(fs::exists(options_.work / "geometry.state"));
  // What was there can be looked at.
  const scenes::ViewedPlace left = scenes::open_viewed_place(options_.work);
  EXPECT_GT(left.scene.surfels->size(), 1000U);
  ASSERT_EQ(left.cameras->views.size(), set_.training.size());
  EXPECT_EQ(left.cameras->views[1].frame, set_.training[1].name);
  EXPECT_THAT(training::training_progress(options_.work),
              ::testing::HasSubstr(", iteration "));
  options_.checkpoint_every_s = 0.0;
  options_.resume = true;
  const training::TrainedScene resumed = training::train_scene(set_, start_, options_);

  training::TrainingOptions whole_options = options_;
  whole_options.resume = false;
  whole_options.work = folder_ / "whole";
  const training::TrainedScene whole = training::train_scene(set_, start_, whole_options);
  expect_same(resumed, whole);
  ASSERT_TRUE(whole.model.has_value());
  EXPECT_EQ(whole.surfels.semantic_feature.size(), whole.surfels.size());
  EXPECT_TRUE(fs::exists(whole_options.work / "preview.png"));
  EXPECT_THAT(core::read_file(whole_options.work / "losses.csv"),
              ::testing::AllOf(::testing::HasSubstr("geometry,10,"),
                               ::testing::HasSubstr("labels,10,")));

  // Another seed is another run.
  options_.seed = 2;
  EXPECT_THROW((void)training::train_scene(set_, start_, options_), core::InputError);
  training::remove_training_state(options_.work);
  EXPECT_FALSE(fs::exists(options_.work / "geometry.state"));
  EXPECT_FALSE(training::is_training_folder(options_.work));
}

TEST_F(TrainingRunTest, LossThatIsNoNumberKeepsTheState) {
  options_.head = "none";
  options_.config.geometry.loss.max_depth_m = INFINITY;
  half_of_geometry();
  const std::string state = core::read_file(options_.work / "geometry.state");
  // The frames change behind the state's back; their names are all it knows.
  for (auto& view : set_.training) {
    for (float& depth_m : view.depth_m.pixels()) depth_m = 3e38F;
  }
  options_.resume = true;
  options_.time_limit_s = 0.0;
  EXPECT_THAT(
      tests::input_error_of([&] { (void)training::train_scene(set_, start_, options_); }),
      ::testing::AllOf(::testing::HasSubstr("loss at iteration 6, frame view"),
                       ::testing::HasSubstr("expected a finite number"),
                       ::testing::HasSubstr("is kept: --resume goes on there")));
  EXPECT_EQ(core::read_file(folder_ / "work" / "geometry.state"), state);
}

TEST_F(TrainingRunTest, TooLittleMemoryKeepsTheStateAndSaysWhatToLower) {
  options_.head = "none";
  (void)training::train_scene(set_, start_, options_);
  const std::string state = core::read_file(options_.work / "geometry.state");
  options_.resume = true;
  set_.intrinsics.width_px = set_.intrinsics.height_px =
      20'000'000;  // More than can be addressed.
  EXPECT_THAT(
      tests::input_error_of([&] { (void)training::train_scene(set_, start_, options_); }),
      ::testing::AllOf(::testing::HasSubstr("training shape and colour: expected memory"),
                       ::testing::HasSubstr("geometry.densify.max_surfels"),
                       ::testing::HasSubstr("is kept: --resume goes on there"),
                       ::testing::HasSubstr("found the host's full")));
  EXPECT_EQ(core::read_file(options_.work / "geometry.state"), state);
  EXPECT_THAT(tests::input_error_of([] {
                reconstruction::with_memory_errors(
                    "a test", [] { return std::string("less"); },
                    [] { throw std::bad_alloc(); });
              }),
              "a test: expected memory for it (less), found the host's full");
}

TEST_F(TrainingRunTest, FramesWithoutDepthTrainLabelsOnTheDepthOfTheSurfels) {
  for (auto& view : set_.training) view.depth_m = {};
  options_.config.panoptic.iterations = 200;
  const training::TrainedScene scene = training::train_scene(set_, start_, options_);
  EXPECT_TRUE(scene.surfels.has_labels());
  EXPECT_GT(scene.quality.mean_iou, 0.1);
}

TEST_F(TrainingRunTest, RefinedPosesComeBackAndHeldOutViewsAreAligned) {
  options_.head = "none";
  options_.config.geometry.rate.pose_rotation = 1e-3;
  options_.config.geometry.rate.pose_translation = 1e-3;
  options_.align_held_out = true;
  auto& moved = set_.held_out[1].T_world_camera;
  moved = {moved.rotation(), moved.translation_m() + glm::dvec3(0.015, 0.0, 0.0)};
  const training::TrainedScene scene = training::train_scene(set_, start_, options_);
  ASSERT_TRUE(scene.aligned_quality.has_value());
  EXPECT_GT(scene.aligned_quality->color.psnr_db(), scene.quality.color.psnr_db());
  const auto figure = [&](const std::string& name) {
    for (const auto& [key, value] : scene.statistics) {
      if (key == name) return value;
    }
    return -1.0;
  };
  EXPECT_GT(figure("held_out_aligned_psnr_db"), figure("held_out_psnr_db"));
  EXPECT_NEAR(figure("held_out_pose_largest_shift_m"), 0.015, 0.007);
  EXPECT_GT(figure("pose_mean_shift_m"), 0.0);
  ASSERT_EQ(scene.refined_poses.size(), set_.training.size());
  EXPECT_NE(scene.refined_poses[0].translation_m(),
            set_.training[0].T_world_camera.translation_m());
}

/// A recording of colour alone.
class ColorOnly final : public reconstruction::RgbdSequence {
 public:
  const std::string& name() const override { return name_; }
  const core::CameraIntrinsics& intrinsics() const override { return camera_; }
  std::size_t frame_count() const override { return 1; }
  const std::string& frame_name(std::size_t) const override { return name_; }
  const core::CameraPose& pose(std::size_t) const override { return pose_; }
  bool has_depth() const override { return false; }
  bool has_masks() const override { return false; }
  const std::vector<core::SceneClass>& classes() const override { return classes_; }
  const std::vector<core::SceneInstance>& instances() const override { return instances_; }
  const std::vector<std::string>& warnings() const override { return lines_; }
  const std::vector<std::string>& notes() const override { return lines_; }
  reconstruction::RgbdFrame load(std::size_t) const override { return {}; }

 private:
  std::string name_ = "colour";
  core::CameraIntrinsics camera_ = core::CameraIntrinsics::from_fov(8, 6, 1.0);
  core::CameraPose pose_;
  std::vector<core::SceneClass> classes_;
  std::vector<core::SceneInstance> instances_;
  std::vector<std::string> lines_;
};

TEST_F(TrainingRunTest, FramesWithoutDepthNeedACloud) {
  scenes::ReconstructOptions reconstruct;
  for (const bool trains : {false, true}) {
    if (trains) reconstruct.training = options_;
    EXPECT_THAT(tests::input_error_of([&] {
                  (void)scenes::reconstruct_bundle(ColorOnly(), reconstruct,
                                                   folder_ / "bundle");
                }),
                "colour: expected frames with depth, or a cloud to start from (--start), "
                "found colour alone");
  }
  EXPECT_FALSE(fs::exists(folder_ / "bundle"));
}

TEST_F(TrainingRunTest, EveryHeadLabelsTheSurfels) {
  for (const std::string& head : reconstruction::panoptic_head_names()) {
    options_.head = head;
    options_.work = folder_ / head;
    options_.config.panoptic.iterations = 200;
    const training::TrainedScene scene = training::train_scene(set_, start_, options_);
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
  const training::TrainedScene scene = training::train_scene(set_, start_, options_);
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
  const auto instances = reconstruction::instances_of(surfels, classes);
  ASSERT_EQ(instances.size(), 1U);  // 9 is a floor.
  EXPECT_EQ(instances[0].id, 7);
  EXPECT_EQ(instances[0].class_id, 2);
  EXPECT_EQ(instances[0].name, "chair 7");
  EXPECT_NEAR(instances[0].box_max_m.x, 2.0, 1e-6);
}

TEST(Coverage, WarnsOfThinScenes) {
  core::SceneManifest manifest;
  EXPECT_EQ(scenes::coverage_warning(manifest), "");
  scenes::RobotCoverage coverage;
  coverage.views = 10, coverage.mean_alpha = 0.95, coverage.thin_views = 1;
  manifest.statistics = coverage.listing();
  EXPECT_EQ(scenes::coverage_warning(manifest), "");
  coverage.thin_views = 2;
  manifest.statistics = coverage.listing();
  EXPECT_THAT(scenes::coverage_warning(manifest), ::testing::HasSubstr("20 %"));
  coverage.thin_views = 0, coverage.mean_alpha = 0.5;
  manifest.statistics = coverage.listing();
  EXPECT_THAT(scenes::coverage_warning(manifest), ::testing::HasSubstr("50 %"));
}

}  // namespace
}  // namespace segsim::experiments
