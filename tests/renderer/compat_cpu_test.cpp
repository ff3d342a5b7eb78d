// The fast renderer under the rules of the two 2DGS programs, against the reference.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "core/frames.h"
#include "renderer/cpu_renderer.h"
#include "renderer/reference_renderer.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer {
namespace {

using core::CameraIntrinsics;
using core::CameraPose;
using core::Channels;
using core::Frame;
using testing::add;
using testing::Surfel;

struct View {
  std::shared_ptr<const SurfelCloud> scene;
  CameraPose pose;
  CameraIntrinsics intrinsics;
};

const CameraIntrinsics kOddCamera{77, 61, 70.0, 64.0, 36.3, 31.8};

/// Pixels may differ where rounding decides whether a rounded-up radius reaches a tile, alpha
/// 1/255 or T 1e-4: 1 in 1000.
void expect_agreement(const View& view, const RenderOptions& options) {
  const Frame reference = make_reference_renderer(view.scene, options)
                              ->render(view.pose, view.intrinsics, Channels::kAll);
  const Frame frame = make_cpu_renderer(view.scene, options)
                          ->render(view.pose, view.intrinsics, Channels::kAll);
  int off = 0, labels_off = 0, depth_off = 0, surfaces = 0;
  for (std::size_t i = 0; i < frame.alpha.size(); ++i) {
    const core::Rgb8 a = frame.rgb.pixels()[i], b = reference.rgb.pixels()[i];
    const float alpha = reference.alpha.pixels()[i];
    const bool colour =
        std::max({std::abs(a.r - b.r), std::abs(a.g - b.g), std::abs(a.b - b.b)}) <= 1;
    off += colour && std::abs(frame.alpha.pixels()[i] - alpha) < 1e-3F ? 0 : 1;
    if (std::abs(alpha - 0.5F) < 1e-3F || alpha < 0.5F) continue;
    ++surfaces;
    labels_off += frame.semantic.pixels()[i] == reference.semantic.pixels()[i] ? 0 : 1;
    const float depth_m = reference.depth_m.pixels()[i];
    const float error_m = std::abs(frame.depth_m.pixels()[i] - depth_m);
    depth_off += error_m <= 1e-3F * std::abs(depth_m) ? 0 : 1;
  }
  const auto pixels = static_cast<double>(frame.alpha.size());
  EXPECT_GT(surfaces, 100);
  EXPECT_LE(off, 1e-3 * pixels);
  EXPECT_LE(labels_off, 2e-3 * pixels);
  EXPECT_LE(depth_off, 3e-3 * pixels);
  const auto pairs = static_cast<double>(reference.stats.pairs_binned);
  EXPECT_NEAR(static_cast<double>(frame.stats.pairs_binned), pairs, 1e-3 * pairs);
  const auto contributions = static_cast<double>(reference.stats.contributions);
  EXPECT_NEAR(static_cast<double>(frame.stats.contributions), contributions,
              2e-3 * contributions);
  EXPECT_EQ(frame.stats.surfels_projected, reference.stats.surfels_projected);
}

class CompatCpu : public ::testing::TestWithParam<Compat> {};

TEST_P(CompatCpu, MatchesReferenceOutsideAndInside) {
  for (std::uint64_t seed = 50; seed < 54; ++seed) {
    SCOPED_TRACE(seed);
    const auto scene = std::make_shared<const SurfelCloud>(testing::random_scene(seed, 1500));
    const RenderOptions options{.compat = GetParam(), .threads = 1};
    expect_agreement({scene, core::look_at({-4.5, 0.4, 1.0}, {0.0, 0.0, 0.0}), kOddCamera},
                     options);
    expect_agreement({scene, core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2}), kOddCamera},
                     options);
  }
}

TEST_P(CompatCpu, MatchesReferenceInARoom) {
  const auto room = std::make_shared<const SurfelCloud>(testing::room_scene(0.12F));
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(96, 72, 1.3);
  for (const DepthMode depth : {DepthMode::kMedian, DepthMode::kExpected}) {
    const RenderOptions options{.compat = GetParam(), .depth = depth, .threads = 2};
    expect_agreement({room, core::look_at({3.0, 2.5, 1.2}, {5.0, 4.0, 0.6}), camera}, options);
    expect_agreement({room, core::look_at({2.0, 0.3, 1.5}, {5.0, 0.1, 1.2}), camera}, options);
  }
}

TEST_P(CompatCpu, SecondOpaqueSurfelIsNotBlended) {
  SurfelCloud cloud;
  for (int i = 0; i < 2; ++i) {
    Surfel s;
    s.position_m = {0.0F, 0.0F, 1.0F + static_cast<float>(i)};
    s.opacity = 1.0F;
    add(cloud, s);
  }
  const auto scene = std::make_shared<const SurfelCloud>(std::move(cloud));
  const CameraIntrinsics camera{33, 33, 50.0, 50.0, 16.5, 16.5};
  const auto alpha = [&](Compat compat) {
    return make_cpu_renderer(scene, {.compat = compat, .threads = 1})
        ->render(CameraPose(), camera, Channels::kRgb)
        .alpha(16, 16);
  };
  EXPECT_NEAR(alpha(GetParam()), 0.99F, 1e-6F);
  EXPECT_NEAR(alpha(Compat::kExact), 0.9999F, 1e-6F);
}

TEST_P(CompatCpu, EmptySceneIsEmpty) {
  const auto scene = std::make_shared<const SurfelCloud>();
  const Frame frame = make_cpu_renderer(scene, {.compat = GetParam()})
                          ->render(CameraPose(), kOddCamera, Channels::kAll);
  EXPECT_EQ(frame.alpha(5, 5), 0.0F);
  EXPECT_EQ(frame.stats.pairs_binned, 0U);
}

/// Under Compat::kExact the two bounds that may miss pixels miss the same ones.
TEST(LossyBounds, MissTheSamePixelsAsTheReference) {
  for (const TileBounds bounds : {TileBounds::kAabb, TileBounds::kPaper}) {
    const RenderOptions options{.bounds = bounds, .threads = 1};
    int missed = 0;
    for (std::uint64_t seed = 60; seed < 63; ++seed) {
      SCOPED_TRACE(seed);
      const auto scene =
          std::make_shared<const SurfelCloud>(testing::random_scene(seed, 1500));
      const CameraPose pose = core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2});
      const Frame reference =
          make_reference_renderer(scene, options)->render(pose, kOddCamera, Channels::kRgb);
      const Frame frame =
          make_cpu_renderer(scene, options)->render(pose, kOddCamera, Channels::kRgb);
      const Frame exact =
          make_reference_renderer(scene)->render(pose, kOddCamera, Channels::kRgb);
      int off = 0;
      for (std::size_t i = 0; i < frame.alpha.size(); ++i) {
        const float alpha = reference.alpha.pixels()[i];
        off += std::abs(frame.alpha.pixels()[i] - alpha) > 1e-3F ? 1 : 0;
        missed += std::abs(exact.alpha.pixels()[i] - alpha) > 1e-2F ? 1 : 0;
      }
      EXPECT_LE(off, 5);
    }
    EXPECT_GT(missed, 100);
  }
}

INSTANTIATE_TEST_SUITE_P(Programs, CompatCpu,
                         ::testing::Values(Compat::kInria, Compat::kGsplat),
                         [](const auto& program) {
                           return program.param == Compat::kInria ? "Inria" : "Gsplat";
                         });

}  // namespace
}  // namespace segsim::renderer
