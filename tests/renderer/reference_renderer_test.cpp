#include "renderer/reference_renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "core/check.h"
#include "core/frames.h"
#include "renderer/scene/surfel_geometry.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer {
namespace {

using core::CameraIntrinsics;
using core::CameraPose;
using core::Channels;
using core::Frame;
using testing::add;
using testing::Surfel;

/// The axis goes through the centre of pixel (16, 16).
const CameraIntrinsics kCamera{33, 33, 50.0, 50.0, 16.5, 16.5};

Frame render(const SurfelCloud& cloud, const RenderOptions& options,
             Channels channels = Channels::kAll, const CameraIntrinsics& intrinsics = kCamera,
             const CameraPose& pose = CameraPose()) {
  return make_reference_renderer(std::make_shared<const SurfelCloud>(cloud), options)
      ->render(pose, intrinsics, channels);
}

/// Three wide discs on the axis, whose weights at pixel (16, 16) are 0.2, 0.8 * 0.6 = 0.48 and
/// 0.32 * 0.9 = 0.288; classes 5, 9, 5; instances 1, 2, 3.
SurfelCloud three_discs() {
  SurfelCloud cloud;
  const float opacity[3] = {0.2F, 0.6F, 0.9F};
  for (int i = 0; i < 3; ++i) {
    Surfel s;
    s.position_m = {0.0F, 0.0F, 1.0F + static_cast<float>(i)};
    s.scale_m = {2.0F, 2.0F};
    s.opacity = opacity[i];
    s.semantic = i == 1 ? 9 : 5;
    s.instance = static_cast<std::uint16_t>(i + 1);
    add(cloud, s);
  }
  return cloud;
}

TEST(ReferenceRenderer, HeaviestSurfelsVote) {
  const Frame one = render(three_discs(), {.top_k = 1});
  EXPECT_EQ(one.semantic(16, 16), 9);
  EXPECT_EQ(one.instance(16, 16), 2);
  EXPECT_FLOAT_EQ(one.confidence(16, 16), 1.0F);
  const Frame two = render(three_discs(), {.top_k = 2});
  EXPECT_EQ(two.semantic(16, 16), 9);
  EXPECT_NEAR(two.confidence(16, 16), 0.48 / 0.768, 1e-6);
  EXPECT_NEAR(two.instance_confidence(16, 16), 0.48 / 0.768, 1e-6);
  const Frame three = render(three_discs(), {.top_k = 3});
  EXPECT_EQ(three.semantic(16, 16), 5);  // 0.2 + 0.288 against 0.48
  EXPECT_NEAR(three.confidence(16, 16), 0.488 / 0.968, 1e-6);
  EXPECT_EQ(three.instance(16, 16), 2);
  EXPECT_NEAR(three.instance_confidence(16, 16), 0.48 / 0.968, 1e-6);
}

TEST(ReferenceRenderer, FirstSurfelsVote) {
  const auto first = [](int k) {
    return render(three_discs(), {.top_k = k, .top_k_rule = TopKRule::kFirst});
  };
  EXPECT_EQ(first(1).semantic(16, 16), 5);
  EXPECT_EQ(first(1).instance(16, 16), 1);
  EXPECT_EQ(first(2).semantic(16, 16), 9);
  EXPECT_NEAR(first(2).confidence(16, 16), 0.48 / 0.68, 1e-6);
  EXPECT_EQ(first(3).semantic(16, 16), 5);
}

TEST(ReferenceRenderer, AllSurfelsVote) {
  SurfelCloud cloud = three_discs();
  // 30 faint discs of one class: more together than any of the three, beyond K = 24.
  for (int i = 0; i < 30; ++i) {
    Surfel s;
    s.position_m = {0.0F, 0.0F, 0.5F + 0.01F * static_cast<float>(i)};
    s.scale_m = {2.0F, 2.0F};
    s.opacity = 0.03F;
    s.semantic = 7;
    add(cloud, s);
  }
  const Frame frame = render(cloud, {.top_k = kAllSurfels});
  EXPECT_EQ(frame.semantic(16, 16), 7);
  const double before = std::pow(0.97, 30);
  EXPECT_NEAR(frame.confidence(16, 16), (1.0 - before) / (1.0 - before * 0.032), 1e-6);
  EXPECT_EQ(render(cloud, {.top_k = 4}).semantic(16, 16), 5);
}

TEST(ReferenceRenderer, FeaturesAreMeansOfTheSelection) {
  SurfelCloud cloud = three_discs();
  for (int i = 0; i < 3; ++i) {
    core::SemanticFeature semantic{};
    core::InstanceFeature instance{};
    semantic[0] = static_cast<float>(i + 1);
    semantic[15] = -1.0F;
    instance[31] = static_cast<float>(10 * i);
    cloud.semantic_feature.push_back(semantic);
    cloud.instance_feature.push_back(instance);
  }
  const Frame two = render(cloud, {.top_k = 2}, Channels::kFeatures);
  EXPECT_NEAR(two.semantic_feature(16, 16)[0], (2 * 0.48 + 3 * 0.288) / 0.768, 1e-5);
  EXPECT_NEAR(two.semantic_feature(16, 16)[15], -1.0, 1e-6);
  EXPECT_NEAR(two.instance_feature(16, 16)[31], (10 * 0.48 + 20 * 0.288) / 0.768, 1e-5);
  EXPECT_TRUE(two.semantic.empty());
  const Frame all = render(cloud, {.top_k = kAllSurfels}, Channels::kFeatures);
  EXPECT_NEAR(all.semantic_feature(16, 16)[0], (0.2 + 2 * 0.48 + 3 * 0.288) / 0.968, 1e-5);
}

TEST(ReferenceRenderer, DepthNormalsOfAPlaneAreItsNormal) {
  SurfelCloud cloud;
  Surfel s;
  s.position_m = {0.0F, 0.0F, 2.0F};
  s.R_world_surfel = testing::facing(glm::normalize(glm::vec3(0.4F, -0.2F, -1.0F)));
  s.scale_m = {3.0F, 3.0F};
  s.opacity = 0.99F;
  add(cloud, s);
  const Frame frame = render(cloud, {}, Channels::kDepthNormal | Channels::kNormal);
  EXPECT_TRUE(frame.depth_m.empty());
  ASSERT_EQ(frame.depth_normal.size(), frame.normal.size());
  EXPECT_LT(glm::length(frame.depth_normal(16, 16) - frame.normal(16, 16)), 1e-3F);
}

TEST(ReferenceRenderer, ExactBoundsChangeNothing) {
  const SurfelCloud cloud = testing::random_scene(5, 600);
  const CameraPose pose = core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2});
  const auto with = [&](TileBounds bounds) {
    return render(cloud, {.bounds = bounds}, Channels::kRgb, kCamera, pose);
  };
  EXPECT_EQ(with(TileBounds::kSnugBox).alpha.pixels(),
            with(TileBounds::kAccuTile).alpha.pixels());
}

TEST(ReferenceRenderer, ThreeSigmaSquareLosesOnlyFaintTails) {
  // 4.5 px per sigma about column 34.5: the square ends 14 px to the right, before tile 3.
  SurfelCloud cloud;
  Surfel s;
  s.position_m = {0.0F, 0.0F, 2.0F};
  s.scale_m = {0.09F, 0.09F};
  s.opacity = 1.0F;
  add(cloud, s);
  const CameraIntrinsics camera{80, 40, 100.0, 100.0, 34.5, 20.5};
  const Frame exact = render(cloud, {}, Channels::kRgb, camera);
  const Frame square = render(cloud, {.bounds = TileBounds::kAabb}, Channels::kRgb, camera);
  EXPECT_NEAR(exact.alpha(48, 20), std::exp(-0.5 * std::pow(14.0 / 4.5, 2)), 1e-6);
  EXPECT_EQ(square.alpha(48, 20), 0.0F);
  for (int x = 0; x < 48; ++x) EXPECT_EQ(square.alpha(x, 20), exact.alpha(x, 20)) << x;
  EXPECT_EQ(square.stats.pairs_binned, 2U * 3U);  // Columns 1, 2; rows 0 ... 2.
}

TEST(ReferenceRenderer, PaperBoundsMissPerspective) {
  // Half a metre before the eye and steep: the near half of its image is far longer than the
  // affine ellipse is.
  SurfelCloud cloud;
  Surfel s;
  s.position_m = {0.0F, 0.15F, 0.5F};
  s.R_world_surfel = testing::facing(glm::normalize(glm::vec3(0.0F, -1.0F, -0.1F)));
  s.scale_m = {0.03F, 0.12F};
  s.opacity = 0.9F;
  add(cloud, s);
  const CameraIntrinsics camera{96, 256, 160.0, 160.0, 48.0, 40.0};
  const Frame exact = render(cloud, {}, Channels::kRgb, camera);
  const Frame paper = render(cloud, {.bounds = TileBounds::kPaper}, Channels::kRgb, camera);
  int missed = 0, more = 0;
  for (std::size_t i = 0; i < exact.alpha.size(); ++i) {
    missed += paper.alpha.pixels()[i] < exact.alpha.pixels()[i] ? 1 : 0;
    more += paper.alpha.pixels()[i] > exact.alpha.pixels()[i] ? 1 : 0;
  }
  EXPECT_GT(missed, 20);
  EXPECT_EQ(more, 0);
}

TEST(ReferenceRenderer, PaperOutlineIsExactWithoutPerspective) {
  const ProjectionCamera<double> camera{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0},
                                        100,       100,       32,        32};
  const auto s =
      project_surfel<double>(camera, {0.2, 0.1, 2.0}, {0.08, 0.02, 0.0}, {-0.01, 0.04, 0.0});
  const ScreenEllipse<double> exact = outline_of_disc(s, 9.0), paper = paper_outline(s, 9.0);
  EXPECT_NEAR(paper.cx_px, exact.cx_px, 1e-12);
  EXPECT_NEAR(paper.cy_px, exact.cy_px, 1e-12);
  EXPECT_NEAR(paper.sxx, exact.sxx, 1e-9);
  EXPECT_NEAR(paper.sxy, exact.sxy, 1e-9);
  EXPECT_NEAR(paper.syy, exact.syy, 1e-9);
  // J = 100 / 2 * [0.08 -0.01; 0.02 0.04] px, squared and times 9.
  EXPECT_NEAR(paper.sxx, 9.0 * (16.0 + 0.25), 1e-9);
  EXPECT_NEAR(paper.sxy, 9.0 * (4.0 - 1.0), 1e-9);
  EXPECT_NEAR(paper.syy, 9.0 * (1.0 + 4.0), 1e-9);
}

TEST(ReferenceRenderer, NothingBehindOrTooNearIsDrawn) {
  SurfelCloud cloud;
  for (const float z : {-1.0F, -0.05F, 0.0F, 0.049F}) {
    Surfel s;
    s.position_m = {0.0F, 0.0F, z};
    add(cloud, s);
  }
  const Frame frame = render(cloud, {});
  EXPECT_EQ(*std::max_element(frame.alpha.pixels().begin(), frame.alpha.pixels().end()), 0.0F);
  EXPECT_EQ(frame.stats.surfels_projected, 0U);
}

TEST(ReferenceRenderer, OpacityAtTheThresholdDecides) {
  const auto alpha_of = [](float opacity) {
    SurfelCloud cloud;
    Surfel s;
    s.position_m = {0.0F, 0.0F, 1.0F};
    s.opacity = opacity;
    add(cloud, s);
    return render(cloud, {}).alpha(16, 16);
  };
  EXPECT_EQ(alpha_of(0.999F / 255.0F), 0.0F);
  EXPECT_NEAR(alpha_of(1.001F / 255.0F), 1.001 / 255.0, 1e-8);
}

TEST(ReferenceRenderer, BadArgumentsAreRefused) {
  const auto scene = std::make_shared<const SurfelCloud>(three_discs());
  EXPECT_THROW(static_cast<void>(make_reference_renderer(nullptr)), core::ContractViolation);
  EXPECT_THROW(static_cast<void>(make_reference_renderer(scene, {.top_k = -1})),
               core::ContractViolation);
  EXPECT_THROW(static_cast<void>(make_reference_renderer(scene, {.top_k = 25})),
               core::ContractViolation);
  EXPECT_THROW(
      static_cast<void>(render(three_discs(), {}, Channels::kRgb, CameraIntrinsics{})),
      core::ContractViolation);
}

}  // namespace
}  // namespace segsim::renderer
