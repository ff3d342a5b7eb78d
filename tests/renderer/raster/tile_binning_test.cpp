/// @file
/// The strategies of TileBounds, Top-K and slabs on whole pictures.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "core/frames.h"
#include "renderer/cpu_renderer.h"
#include "renderer/reference_renderer.h"
#include "tests/renderer/scenes.h"
#include "tests/renderer/view_stages.h"

namespace segsim::renderer {
namespace {

using core::CameraIntrinsics;
using core::CameraPose;
using core::Channels;
using core::Frame;

std::shared_ptr<const SurfelCloud> shared(SurfelCloud cloud) {
  return std::make_shared<const SurfelCloud>(std::move(cloud));
}

Frame render_with(const std::shared_ptr<const SurfelCloud>& scene, const CameraPose& pose,
                  const CameraIntrinsics& camera, const RenderOptions& options) {
  return make_cpu_renderer(scene, options)->render(pose, camera, Channels::kAll);
}

testing::Pairs binned_pairs(const std::shared_ptr<const SurfelCloud>& cloud,
                            const CameraPose& pose, const CameraIntrinsics& camera,
                            const RenderOptions& options) {
  testing::ViewStages stages(cloud, pose, camera, options);
  stages.project();
  stages.list();
  return stages.pairs();
}

TEST(TileBins, StrategiesNestAndExactOnesDrawTheSamePicture) {
  const auto room = shared(testing::room_scene(0.12F));
  const CameraPose pose = core::look_at({3.0, 2.5, 1.2}, {5.0, 4.0, 0.6});
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(160, 120, 1.3);
  const auto render = [&](TileBounds bounds) {
    return render_with(room, pose, camera, {.bounds = bounds, .threads = 1});
  };
  const Frame rows = render(TileBounds::kAccuTile), box = render(TileBounds::kSnugBox);
  EXPECT_EQ(rows.rgb.pixels(), box.rgb.pixels());
  EXPECT_EQ(rows.semantic.pixels(), box.semantic.pixels());
  EXPECT_EQ(rows.stats.contributions, box.stats.contributions);
  EXPECT_LT(rows.stats.pairs_binned, box.stats.pairs_binned);
  const testing::Pairs exact = binned_pairs(room, pose, camera, {});
  const testing::Pairs boxes =
      binned_pairs(room, pose, camera, {.bounds = TileBounds::kSnugBox});
  EXPECT_TRUE(std::includes(boxes.begin(), boxes.end(), exact.begin(), exact.end()));
  const Frame square = render(TileBounds::kAabb), paper = render(TileBounds::kPaper);
  EXPECT_GT(square.stats.pairs_binned, box.stats.pairs_binned);
  EXPECT_GT(paper.stats.pairs_binned, rows.stats.pairs_binned / 2);
  EXPECT_NE(paper.stats.pairs_binned, rows.stats.pairs_binned);
}

TEST(CpuRendererProperties, HundredThousandRandomSurfels) {
  // So faint that none hides another: every one counts in the comparison.
  const CameraIntrinsics camera{40, 32, 36.0, 34.0, 19.3, 16.8};
  for (std::uint64_t seed = 0; seed < 25; ++seed) {
    SCOPED_TRACE(seed);
    SurfelCloud cloud = testing::random_scene(seed + 100, 4000);
    core::RandomStream random(seed, "faint");
    for (float& opacity : cloud.opacity) {
      // One in five at the threshold of visibility.
      opacity = static_cast<float>(random.chance(0.2) ? random.uniform(0.0039, 0.00395)
                                                      : random.uniform(0.004, 0.03));
    }
    const auto scene = shared(std::move(cloud));
    const CameraPose pose = seed % 2 == 0 ? core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2})
                                          : core::look_at({-2.5, 0.4, 1.0}, {0.0, 0.0, 0.0});
    const Frame expected =
        make_reference_renderer(scene, {})->render(pose, camera, Channels::kAll);
    const Frame frame = render_with(scene, pose, camera, {.threads = 1});
    const auto count = static_cast<double>(expected.stats.contributions);
    EXPECT_NEAR(static_cast<double>(frame.stats.contributions), count, 2e-4 * count + 2.0);
    for (std::size_t i = 0; i < frame.alpha.size(); ++i) {
      // A surfel that passes the threshold differently changes alpha by 1/255.
      EXPECT_NEAR(frame.alpha.pixels()[i], expected.alpha.pixels()[i], 5e-3);
    }
    double off = 0.0;
    for (std::size_t i = 0; i < frame.alpha.size(); ++i) {
      off += std::abs(frame.alpha.pixels()[i] - expected.alpha.pixels()[i]) > 5e-4F ? 1 : 0;
    }
    EXPECT_LE(off, 0.005 * static_cast<double>(frame.alpha.size()));
  }
}

/// Agreement of labels on all but a few pixels.
void expect_labels(const Frame& frame, const Frame& expected) {
  double off = 0.0, confidence_off = 0.0;
  for (std::size_t i = 0; i < frame.semantic.size(); ++i) {
    off += frame.semantic.pixels()[i] != expected.semantic.pixels()[i] ||
                   frame.instance.pixels()[i] != expected.instance.pixels()[i]
               ? 1
               : 0;
    confidence_off +=
        std::abs(frame.confidence.pixels()[i] - expected.confidence.pixels()[i]) > 2e-3F ? 1
                                                                                         : 0;
  }
  EXPECT_LE(off, 2e-3 * static_cast<double>(frame.semantic.size()));
  EXPECT_LE(confidence_off, 5e-3 * static_cast<double>(frame.semantic.size()));
}

TEST(CpuRendererProperties, BothReadingsOfTopKAndAllSurfels) {
  const auto scene = shared(testing::random_scene(3, 1200));
  const CameraPose pose = core::look_at({-4.0, 0.4, 1.0}, {0.0, 0.0, 0.0});
  const CameraIntrinsics camera{77, 61, 70.0, 64.0, 36.3, 31.8};
  for (const TopKRule rule : {TopKRule::kHeaviest, TopKRule::kFirst}) {
    for (const int top_k : {1, 3, 8, 16, kAllSurfels}) {
      SCOPED_TRACE(top_k);
      const RenderOptions options{.top_k = top_k, .top_k_rule = rule, .threads = 1};
      expect_labels(
          render_with(scene, pose, camera, options),
          make_reference_renderer(scene, options)->render(pose, camera, Channels::kAll));
    }
  }
}

TEST(CpuRendererProperties, LabelsAloneAreThoseOfAllChannels) {
  const auto room = shared(testing::room_scene(0.12F));
  const CameraPose pose = core::look_at({3.0, 2.5, 1.2}, {5.0, 4.0, 0.6});
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(160, 120, 1.3);
  for (const int top_k : {1, 4, 8}) {
    const auto renderer = make_cpu_renderer(room, {.top_k = top_k, .threads = 1});
    const Frame all = renderer->render(pose, camera, Channels::kAll);
    const Frame labels = renderer->render(pose, camera, Channels::kLabels);
    EXPECT_EQ(labels.semantic.pixels(), all.semantic.pixels());
    EXPECT_EQ(labels.instance.pixels(), all.instance.pixels());
    EXPECT_EQ(labels.confidence.pixels(), all.confidence.pixels());
    EXPECT_LT(labels.stats.evaluations, all.stats.evaluations);
  }
}

TEST(CpuRendererSlabs, PictureIsThatOfTheReference) {
  // Three slabs and more.
  const auto room = shared(testing::room_scene(0.045F));
  const CameraPose pose = core::look_at({0.4, 0.4, 1.6}, {5.0, 4.0, 0.9});
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(40, 30, 1.4);
  const Frame frame = render_with(room, pose, camera, {.threads = 2});
  const Frame expected =
      make_reference_renderer(room, {})->render(pose, camera, Channels::kAll);
  int off = 0;
  for (std::size_t i = 0; i < frame.rgb.size(); ++i) {
    const auto a = frame.rgb.pixels()[i], b = expected.rgb.pixels()[i];
    off +=
        std::max({std::abs(a.r - b.r), std::abs(a.g - b.g), std::abs(a.b - b.b)}) > 1 ? 1 : 0;
    EXPECT_NEAR(frame.alpha.pixels()[i], expected.alpha.pixels()[i], 1e-3);
  }
  EXPECT_LE(off, 2);
  expect_labels(frame, expected);
}

TEST(CpuRendererSlabs, WhatLiesBehindAWallIsNeitherProjectedNorBinned) {
  SurfelCloud near_wall;
  core::RandomStream random(5, "walls");
  const auto wall = [&](SurfelCloud& cloud, float x_m, std::uint16_t id) {
    testing::add_rectangle(cloud, random, {x_m, -2.0F, -2.0F}, {0.0F, 4.0F, 0.0F},
                           {0.0F, 0.0F, 4.0F}, 0.015F, id, id);
  };
  for (const float x_m : {2.0F, 2.02F, 2.04F}) wall(near_wall, x_m, 1);  // No light passes.
  SurfelCloud many = near_wall;
  for (int i = 0; i < 6; ++i) wall(many, 3.0F + 0.4F * static_cast<float>(i), 2);
  const CameraPose pose = core::look_at({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0});
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(96, 96, 0.9);
  const Frame one = render_with(shared(near_wall), pose, camera, {.threads = 1});
  const Frame all = render_with(shared(many), pose, camera, {.threads = 1});
  EXPECT_EQ(one.rgb.pixels(), all.rgb.pixels());
  EXPECT_EQ(one.alpha.pixels(), all.alpha.pixels());
  EXPECT_GT(one.stats.surfels_projected, 20000U);
  const std::size_t everything = binned_pairs(shared(many), pose, camera, {}).size();
  EXPECT_LT(all.stats.pairs_binned, everything / 2);
}

}  // namespace
}  // namespace segsim::renderer
