// Trials of one episode share their views: what is copied equals what would be drawn.
#include "experiments/trials/shared_views.h"

#include <cmath>
#include <set>
#include <thread>

#include <gtest/gtest.h>

#include "experiments/runs/internal/task_queue.h"
#include "renderer/cpu_renderer.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments::trials {
namespace {

constexpr core::Channels kChannels = core::Channels::kRgbd | core::Channels::kLabels;

core::CameraPose camera_at(double x_m, double heading_rad) {
  const core::Pose2 pose{x_m, 0.0, heading_rad};
  return core::transform_from_pose2<core::frame::World>(pose) * core::mast_camera(1.0, 0.2);
}

void expect_equal(const core::Frame& a, const core::Frame& b) {
  EXPECT_EQ(a.rgb.pixels(), b.rgb.pixels());
  EXPECT_EQ(a.semantic.pixels(), b.semantic.pixels());
  EXPECT_EQ(a.instance.pixels(), b.instance.pixels());
  EXPECT_EQ(a.alpha.pixels(), b.alpha.pixels());
  ASSERT_EQ(a.depth_m.size(), b.depth_m.size());
  for (std::size_t k = 0; k < a.depth_m.size(); ++k) {
    const float x = a.depth_m.pixels()[k], y = b.depth_m.pixels()[k];
    ASSERT_TRUE(x == y || (std::isnan(x) && std::isnan(y))) << "pixel " << k;
  }
}

/// The scene's renderer; counts what it draws.
class CountingRenderer final : public core::Renderer {
 public:
  using core::Renderer::render;
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              core::Channels channels, core::Frame& frame) override {
    ++drawn;
    renderer_->render(T_world_camera, intrinsics, channels, frame);
  }
  int drawn = 0;

 private:
  std::unique_ptr<core::Renderer> renderer_ = renderer::make_cpu_renderer(
      std::make_shared<renderer::SurfelCloud>(TinyScene().surfels()), {});
};

class SharedViewsTest : public testing::Test {
 protected:
  CountingRenderer renderer_, plain_;
  core::CameraIntrinsics camera_ = core::CameraIntrinsics::from_fov(64, 48, 1.2);
};

TEST_F(SharedViewsTest, WhatIsCopiedIsWhatWouldBeDrawn) {
  SharedViews views(renderer_);
  core::Frame frame;
  for (int pass = 0; pass < 2; ++pass) {
    for (int k = 0; k < 6; ++k) {
      const core::CameraPose pose = camera_at(0.3 * k - 3.0, 0.5 * k);
      views.render(pose, camera_, kChannels, frame);
      expect_equal(frame, plain_.render(pose, camera_, kChannels));
    }
  }
  EXPECT_EQ(renderer_.drawn, 6) << "of 12 views";
}

TEST_F(SharedViewsTest, TheLastBitOfAPoseMakesAnotherView) {
  SharedViews views(renderer_);
  core::Frame frame;
  views.render(camera_at(1.0, 0.0), camera_, kChannels, frame);
  const core::CameraPose next = camera_at(std::nextafter(1.0, 2.0), 0.0);
  views.render(next, camera_, kChannels, frame);
  EXPECT_EQ(frame.T_world_camera.translation_m(), next.translation_m());
  views.render(camera_at(1.0, 0.0), camera_, core::Channels::kRgb, frame);
  EXPECT_TRUE(frame.depth_m.empty()) << "other channels, another image";
  views.render(camera_at(1.0, 0.0), camera_.resized(32, 24), kChannels, frame);
  EXPECT_EQ(frame.rgb.width_px(), 32);
  EXPECT_EQ(renderer_.drawn, 4);
}

TEST_F(SharedViewsTest, BeyondItsCapacityItDrawsAnew) {
  const std::size_t frame_bytes = 64 * 48 * (3 + 4 + 4 + 2 + 2 + 4 + 4);
  SharedViews views(renderer_, 2 * frame_bytes);
  core::Frame frame;
  for (int pass = 0; pass < 2; ++pass) {
    for (int k = 0; k < 3; ++k) {
      const core::CameraPose pose = camera_at(0.5 * k, 0.0);
      views.render(pose, camera_, kChannels, frame);
      expect_equal(frame, plain_.render(pose, camera_, kChannels));
    }
  }
  EXPECT_EQ(renderer_.drawn, 4) << "of 6 views the first two are shared, once each";
}

/// `episodes` episodes with `arms` trials each.
std::vector<TrialTask> tasks_of(const std::vector<sim::Episode>& episodes, int arms) {
  std::vector<TrialTask> tasks;
  for (const sim::Episode& episode : episodes) {
    for (int arm = 0; arm < arms; ++arm) tasks.push_back({nullptr, &episode, nullptr});
  }
  return tasks;
}

TEST(TaskQueue, WholeEpisodesWhileThereAreEnoughThenTrialByTrial) {
  const std::vector<sim::Episode> episodes(4);
  const std::vector<TrialTask> tasks = tasks_of(episodes, 3);
  runs::internal::TaskQueue queue(tasks, 2);
  std::vector<std::size_t> sizes;
  const TrialTask* expected = tasks.data();
  for (auto unit = queue.next(); !unit.empty(); unit = queue.next()) {
    EXPECT_EQ(unit.data(), expected) << "in order, none left out";
    expected += unit.size();
    sizes.push_back(unit.size());
  }
  EXPECT_EQ(expected, tasks.data() + tasks.size());
  EXPECT_EQ(sizes, (std::vector<std::size_t>{3, 3, 1, 1, 1, 1, 1, 1}));
  EXPECT_TRUE(queue.next().empty());
}

TEST(TaskQueue, EachTrialGoesToOneOfManyWorkers) {
  const std::vector<sim::Episode> episodes(50);
  const std::vector<TrialTask> tasks = tasks_of(episodes, 5);
  runs::internal::TaskQueue queue(tasks, 4);
  std::mutex mutex;
  std::multiset<const TrialTask*> seen;
  std::vector<std::thread> workers;
  for (int k = 0; k < 4; ++k) {
    workers.emplace_back([&] {
      for (auto unit = queue.next(); !unit.empty(); unit = queue.next()) {
        const std::lock_guard<std::mutex> lock(mutex);
        for (const TrialTask& task : unit) seen.insert(&task);
      }
    });
  }
  for (std::thread& worker : workers) worker.join();
  EXPECT_EQ(seen.size(), tasks.size());
  EXPECT_EQ(std::set<const TrialTask*>(seen.begin(), seen.end()).size(), tasks.size());
}

}  // namespace
}  // namespace segsim::experiments::trials
