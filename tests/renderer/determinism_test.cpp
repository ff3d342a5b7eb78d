/// @file
/// One, two and five threads give the same picture, bit for bit: all channels, every way to
/// select surfels, scenes of several slabs, other programs' rules.

#include <gtest/gtest.h>

#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include <tbb/global_control.h>

#include "renderer/cpu_renderer.h"
#include "renderer/scene/room_scene.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::renderer {
namespace {

using core::Channels;
using core::Frame;

constexpr Channels kEverything = Channels::kAll | Channels::kDepthNormal | Channels::kFeatures;

template <class Pixel>
void expect_same_bits(const core::Image<Pixel>& a, const core::Image<Pixel>& b,
                      const char* name) {
  ASSERT_EQ(a.width_px(), b.width_px()) << name;
  ASSERT_EQ(a.height_px(), b.height_px()) << name;
  ASSERT_FALSE(a.empty()) << name;
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(Pixel)), 0) << name;
}

void expect_same_bits(const Frame& a, const Frame& b) {
  expect_same_bits(a.rgb, b.rgb, "rgb");
  expect_same_bits(a.depth_m, b.depth_m, "depth");
  expect_same_bits(a.normal, b.normal, "normal");
  expect_same_bits(a.alpha, b.alpha, "alpha");
  expect_same_bits(a.semantic, b.semantic, "semantic");
  expect_same_bits(a.instance, b.instance, "instance");
  expect_same_bits(a.confidence, b.confidence, "confidence");
  expect_same_bits(a.instance_confidence, b.instance_confidence, "instance confidence");
  expect_same_bits(a.depth_normal, b.depth_normal, "depth normal");
  expect_same_bits(a.semantic_feature, b.semantic_feature, "semantic feature");
  expect_same_bits(a.instance_feature, b.instance_feature, "instance feature");
  EXPECT_EQ(a.stats.surfels_projected, b.stats.surfels_projected);
  EXPECT_EQ(a.stats.pairs_binned, b.stats.pairs_binned);
  EXPECT_EQ(a.stats.pairs_touched, b.stats.pairs_touched);
  EXPECT_EQ(a.stats.evaluations, b.stats.evaluations);
  EXPECT_EQ(a.stats.contributions, b.stats.contributions);
  EXPECT_EQ(a.stats.feature_fetches, b.stats.feature_fetches);
}

class Determinism : public ::testing::Test {
 protected:
  /// So many clusters that a view takes several slabs.
  Determinism()
      : room_(std::make_shared<const SurfelCloud>(
            make_room_scene({.surfel_count = 120'000, .features = true}))),
        // Else a machine of two processors would run all with two threads.
        five_(tbb::global_control::max_allowed_parallelism, 5) {}

  void expect_same_pictures(RenderOptions options,
                            std::shared_ptr<const PanopticField> field = nullptr) const {
    const auto camera = room_camera(203, 117);
    const auto poses = room_camera_ring(3);
    options.threads = 1;
    std::vector<Frame> expected;
    const auto one = make_cpu_renderer(room_, options, field);
    for (const auto& pose : poses) expected.push_back(one->render(pose, camera, kEverything));
    for (const int threads : {2, 5}) {
      SCOPED_TRACE(std::to_string(threads) + " threads");
      options.threads = threads;
      const auto many = make_cpu_renderer(room_, options, field);
      Frame frame;
      for (int repeat = 0; repeat < 2; ++repeat) {
        for (std::size_t i = 0; i < poses.size(); ++i) {
          many->render(poses[i], camera, kEverything, frame);
          expect_same_bits(frame, expected[i]);
        }
      }
    }
  }

  std::shared_ptr<const SurfelCloud> room_;
  tbb::global_control five_;
};

TEST_F(Determinism, HeaviestSurfels) { expect_same_pictures({.top_k = 4}); }

TEST_F(Determinism, MoreKeysThanRegisters) { expect_same_pictures({.top_k = 16}); }

TEST_F(Determinism, FirstSurfels) {
  expect_same_pictures({.top_k = 3, .top_k_rule = TopKRule::kFirst});
}

TEST_F(Determinism, AllSurfels) { expect_same_pictures({.top_k = kAllSurfels}); }

TEST_F(Determinism, ExpectedDepthWithoutSlabs) {
  expect_same_pictures({.depth = DepthMode::kExpected, .skip_hidden = false});
}

TEST_F(Determinism, OtherProgramsRules) {
  expect_same_pictures({.compat = Compat::kInria});
  expect_same_pictures({.compat = Compat::kGsplat});
}

TEST_F(Determinism, PanopticField) {
  const auto field = std::make_shared<const PanopticField>(
      fold_panoptic_model(*room_, testing::random_model(4, 12, 30)));
  expect_same_pictures({.top_k = 4}, field);
}

TEST_F(Determinism, SlabsDoNotChangeThePicture) {
  const auto camera = room_camera(203, 117);
  const auto with = make_cpu_renderer(room_, {.threads = 2});
  const auto without = make_cpu_renderer(room_, {.threads = 2, .skip_hidden = false});
  for (const auto& pose : room_camera_ring(3)) {
    Frame a = with->render(pose, camera, kEverything);
    const Frame b = without->render(pose, camera, kEverything);
    EXPECT_LT(a.stats.pairs_binned, b.stats.pairs_binned);
    a.stats = b.stats;
    expect_same_bits(a, b);
  }
}

}  // namespace
}  // namespace segsim::renderer
