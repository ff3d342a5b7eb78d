#include "renderer/cpu_renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>

#include <glm/geometric.hpp>

#include "core/frames.h"
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

std::shared_ptr<const SurfelCloud> shared(SurfelCloud cloud) {
  return std::make_shared<const SurfelCloud>(std::move(cloud));
}

/// How far a picture is from the reference.
struct Difference {
  int pixels = 0;
  int colour_off = 0, depth_off = 0, labels_off = 0, normal_off = 0, alpha_off = 0,
      labelled = 0;
  int worst_colour = 0;
  double worst_depth = 0.0;
  double contributions = 0.0;  ///< Relative difference of the counts.
};

int colour_distance(const core::Rgb8& a, const core::Rgb8& b) {
  return std::max({std::abs(a.r - b.r), std::abs(a.g - b.g), std::abs(a.b - b.b)});
}

Difference compare(const Frame& frame, const Frame& reference) {
  Difference d;
  d.pixels = static_cast<int>(frame.alpha.size());
  for (std::size_t i = 0; i < frame.alpha.size(); ++i) {
    const int colour = colour_distance(frame.rgb.pixels()[i], reference.rgb.pixels()[i]);
    d.worst_colour = std::max(d.worst_colour, colour);
    d.colour_off += colour > 1 ? 1 : 0;
    d.alpha_off +=
        std::abs(frame.alpha.pixels()[i] - reference.alpha.pixels()[i]) > 1e-3F ? 1 : 0;
    const float a = frame.depth_m.pixels()[i], b = reference.depth_m.pixels()[i];
    // At alpha = 1/2 rounding decides whether there is a surface at all.
    if (std::isnan(a) != std::isnan(b)) {
      d.depth_off += std::abs(reference.alpha.pixels()[i] - 0.5F) > 5e-3F ? 1 : 0;
      continue;
    }
    if (std::isnan(a)) continue;
    const double depth = std::abs(a - b) / b;
    d.worst_depth = std::max(d.worst_depth, depth);
    d.depth_off += depth > 1e-3 ? 1 : 0;
    d.normal_off +=
        glm::length(frame.normal.pixels()[i] - reference.normal.pixels()[i]) > 0.02F ? 1 : 0;
    ++d.labelled;
    d.labels_off += frame.semantic.pixels()[i] != reference.semantic.pixels()[i] ||
                            frame.instance.pixels()[i] != reference.instance.pixels()[i]
                        ? 1
                        : 0;
  }
  return d;
}

/// Colour within 1/255, alpha and depth within 1e-3 and labels equal on at least 99.9 % of the
/// pixels: the rest may lie where a surfel's alpha passes 1/255 or a pixel's T passes 1e-4.
void expect_agreement(const Frame& frame, const Frame& reference) {
  const Difference d = compare(frame, reference);
  const double allowed = 1e-3 * d.pixels;
  EXPECT_LE(d.colour_off, allowed) << "worst " << d.worst_colour;
  EXPECT_LE(d.worst_colour, 6);
  EXPECT_LE(d.alpha_off, allowed);
  EXPECT_LE(d.depth_off, allowed) << "worst " << d.worst_depth;
  EXPECT_LE(d.normal_off, allowed);
  EXPECT_LE(d.labels_off, 1e-3 * d.labelled + 1.0);
  const auto counted = static_cast<double>(frame.stats.contributions);
  const auto expected = static_cast<double>(reference.stats.contributions);
  EXPECT_NEAR(counted, expected, 1e-3 * expected + 2.0);
  ::testing::Test::RecordProperty("worst_colour", d.worst_colour);
  ::testing::Test::RecordProperty("worst_depth", std::to_string(d.worst_depth));
  ::testing::Test::RecordProperty("colour_off", d.colour_off);
  ::testing::Test::RecordProperty("labels_off", d.labels_off);
}

Frame render_with(const std::shared_ptr<const SurfelCloud>& scene, const CameraPose& pose,
                  const CameraIntrinsics& intrinsics,
                  const RenderOptions& options = {.threads = 1}) {
  return make_cpu_renderer(scene, options)->render(pose, intrinsics, Channels::kAll);
}

void expect_matches_reference(const std::shared_ptr<const SurfelCloud>& scene,
                              const CameraPose& pose, const CameraIntrinsics& intrinsics,
                              const RenderOptions& options = {.threads = 1}) {
  const Frame reference =
      make_reference_renderer(scene, options)->render(pose, intrinsics, Channels::kAll);
  expect_agreement(render_with(scene, pose, intrinsics, options), reference);
}

/// Not a multiple of the tile, principal point off the centre, pixels not square.
const CameraIntrinsics kOddCamera{77, 61, 70.0, 64.0, 36.3, 31.8};

TEST(CpuRenderer, MatchesReferenceFromOutsideARandomScene) {
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    SCOPED_TRACE(seed);
    expect_matches_reference(shared(testing::random_scene(seed, 1500)),
                             core::look_at({-4.5, 0.4, 1.0}, {0.0, 0.0, 0.0}), kOddCamera);
  }
}

TEST(CpuRenderer, MatchesReferenceFromInsideARandomScene) {
  // Many discs reach through the camera here.
  for (std::uint64_t seed = 10; seed < 14; ++seed) {
    SCOPED_TRACE(seed);
    expect_matches_reference(shared(testing::random_scene(seed, 1500)),
                             core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2}), kOddCamera);
  }
}

TEST(CpuRenderer, MatchesReferenceInARoom) {
  const auto room = shared(testing::room_scene(0.12F));
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(96, 72, 1.3);
  expect_matches_reference(room, core::look_at({3.0, 2.5, 1.2}, {5.0, 4.0, 0.6}), camera);
  // 30 cm from a wall, along it.
  expect_matches_reference(room, core::look_at({2.0, 0.3, 1.5}, {5.0, 0.1, 1.2}), camera);
}

TEST(CpuRenderer, DistantRoomHasSurfelsBelowAPixel) {
  expect_matches_reference(shared(testing::room_scene(0.15F, 3)),
                           core::look_at({-30.0, -20.0, 12.0}, {3.0, 2.5, 1.0}),
                           CameraIntrinsics::from_fov(80, 60, 0.4));
}

TEST(CpuRenderer, MatchesReferenceInExpectedDepth) {
  const auto scene = shared(testing::room_scene(0.12F));
  const CameraPose pose = core::look_at({3.0, 2.5, 1.2}, {5.0, 4.0, 0.6});
  expect_matches_reference(scene, pose, CameraIntrinsics::from_fov(96, 72, 1.3),
                           {.depth = DepthMode::kExpected, .threads = 1});
}

TEST(CpuRenderer, MedianDepthDoesNotFloatBetweenSurfaces) {
  // A half-transparent disc before an opaque one: the mean of their depths belongs to neither.
  SurfelCloud cloud;
  add(cloud, {.position_m = {0.0F, 0.0F, 1.0F}, .scale_m = {0.5F, 0.5F}, .opacity = 0.45F});
  add(cloud, {.position_m = {0.0F, 0.0F, 3.0F}, .scale_m = {2.0F, 2.0F}, .opacity = 0.99F});
  const auto scene = shared(cloud);
  const auto intrinsics = CameraIntrinsics::from_fov(33, 33, 0.6);
  const auto depth_at_centre = [&](DepthMode mode) {
    const RenderOptions options{.depth = mode, .threads = 1};
    return render_with(scene, CameraPose(), intrinsics, options).depth_m(16, 16);
  };
  EXPECT_NEAR(depth_at_centre(DepthMode::kMedian), 3.0F, 1e-3F);
  // 0.45 at 1 m, 0.55 * 0.99 at 3 m.
  EXPECT_NEAR(depth_at_centre(DepthMode::kExpected), (0.45 + 3.0 * 0.5445) / 0.9945, 2e-3);
}

TEST(CpuRenderer, MatchesReferenceForEveryTopK) {
  const auto scene = shared(testing::random_scene(3, 1200));
  for (const int top_k : {1, 2, 3, 4, 5, 8, 24}) {
    SCOPED_TRACE(top_k);
    expect_matches_reference(scene, core::look_at({-4.0, 0.4, 1.0}, {0.0, 0.0, 0.0}),
                             kOddCamera, {.top_k = top_k, .threads = 1});
  }
}

TEST(CpuRenderer, SkippingHiddenSurfelsDoesNotChangeTheImage) {
  const auto scene = shared(testing::room_scene(0.03F));
  const CameraPose pose = core::look_at({3.0, 2.5, 1.2}, {5.0, 4.0, 0.6});
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(160, 120, 1.3);
  const Frame skipped = render_with(scene, pose, camera, {.threads = 1});
  const Frame whole = render_with(scene, pose, camera, {.threads = 1, .skip_hidden = false});
  EXPECT_EQ(skipped.rgb.pixels(), whole.rgb.pixels());
  EXPECT_EQ(skipped.alpha.pixels(), whole.alpha.pixels());
  EXPECT_EQ(skipped.semantic.pixels(), whole.semantic.pixels());
  EXPECT_EQ(skipped.instance.pixels(), whole.instance.pixels());
  EXPECT_LT(skipped.stats.pairs_binned, whole.stats.pairs_binned);
}

TEST(CpuRenderer, SphericalHarmonicsChangeWithTheView) {
  SurfelCloud cloud = testing::random_scene(4, 600, 0.5F);
  core::RandomStream random(1, "sh");
  cloud.sh_degree = 3;
  std::vector<glm::vec3> sh(cloud.size() * 16);
  for (std::size_t i = 0; i < sh.size(); ++i) {
    const auto n = [&] { return 0.3F * static_cast<float>(random.normal()); };
    const float r = n(), g = n(), b = n();
    sh[i] = i % 16 == 0 ? cloud.sh[i / 16] : glm::vec3(r, g, b);
  }
  cloud.sh = sh;
  const auto scene = shared(std::move(cloud));
  expect_matches_reference(scene, core::look_at({-4.0, 0.4, 1.0}, {0.0, 0.0, 0.0}),
                           kOddCamera);
  expect_matches_reference(scene, core::look_at({1.0, 4.2, -1.0}, {0.0, 0.0, 0.0}),
                           kOddCamera);
}

TEST(CpuRenderer, HarmonicsOfFewDegreesAreThoseOfMore) {
  // Sums up to degree 1 are made in vectors, others surfel by surfel: zeros tell them apart.
  SurfelCloud few = testing::random_scene(4, 600, 0.5F);
  core::RandomStream random(1, "sh");
  SurfelCloud more = few;
  few.sh_degree = 1;
  more.sh_degree = 2;
  few.sh.assign(few.size() * 4, glm::vec3(0.0F));
  more.sh.assign(few.size() * 9, glm::vec3(0.0F));
  for (std::size_t i = 0; i < few.size(); ++i) {
    for (std::size_t k = 0; k < 4; ++k) {
      const auto n = [&] { return 0.5F * static_cast<float>(random.normal()); };
      const float r = n(), g = n(), b = n();
      few.sh[i * 4 + k] = more.sh[i * 9 + k] = {r, g, b};
    }
  }
  const CameraPose pose = core::look_at({-4.0, 0.4, 1.0}, {0.0, 0.0, 0.0});
  const Frame a = render_with(shared(std::move(few)), pose, kOddCamera);
  const Frame b = render_with(shared(std::move(more)), pose, kOddCamera);
  EXPECT_EQ(a.rgb.pixels(), b.rgb.pixels());
  EXPECT_EQ(a.normal.pixels(), b.normal.pixels());
}

TEST(CpuRenderer, OneSurfelIsTheClosedForm) {
  SurfelCloud cloud;
  Surfel s;
  s.position_m = {2.0F, 0.0F, 0.0F};
  s.R_world_surfel = testing::facing({-1.0F, 0.0F, 0.0F});
  s.scale_m = glm::vec2(0.1F);
  s.opacity = 0.8F;
  s.colour = {1.0F, 0.5F, 0.0F};
  s.semantic = 7;
  s.instance = 300;
  add(cloud, s);
  const CameraIntrinsics camera{65, 65, 100.0, 100.0, 32.5, 32.5};
  const Frame frame =
      render_with(shared(cloud), core::look_at({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}), camera);
  const double sigma_px = 0.1 / 2.0 * 100.0;
  for (int x = 0; x < 65; ++x) {
    const double r = (x - 32) / sigma_px;
    const double alpha = 0.8 * std::exp(-0.5 * r * r);
    EXPECT_NEAR(frame.alpha(x, 32), alpha >= 1.0 / 255.0 ? alpha : 0.0, 2e-5) << x;
  }
  EXPECT_NEAR(frame.rgb(32, 32).r, 204, 1);
  EXPECT_NEAR(frame.rgb(32, 32).g, 102, 1);
  EXPECT_EQ(frame.rgb(32, 32).b, 0);
  EXPECT_NEAR(frame.depth_m(34, 33), 2.0F, 1e-5F);
  EXPECT_NEAR(frame.normal(33, 32).x, -1.0F, 1e-5F);
  EXPECT_EQ(frame.semantic(32, 32), 7);
  EXPECT_EQ(frame.instance(32, 32), 300);
  EXPECT_FLOAT_EQ(frame.confidence(32, 32), 1.0F);
  EXPECT_TRUE(std::isnan(frame.depth_m(0, 0)));
  EXPECT_EQ(frame.normal(0, 0), glm::vec3(0.0F));
  EXPECT_EQ(frame.semantic(0, 0), 0);
}

TEST(CpuRenderer, NearerSurfelWinsAndTiesGoToTheLowerIndex) {
  SurfelCloud cloud;
  Surfel s;
  s.R_world_surfel = testing::facing({-1.0F, 0.0F, 0.0F});
  s.scale_m = glm::vec2(1.0F);
  s.opacity = 0.9F;
  for (int i = 0; i < 3; ++i) {
    s.position_m = {i == 2 ? 1.5F : 2.0F, 0.0F, 0.0F};
    s.colour = glm::vec3(0.0F);
    s.colour[i] = 1.0F;
    s.instance = static_cast<std::uint16_t>(i + 1);
    add(cloud, s);
  }
  const Frame frame =
      render_with(shared(cloud), core::look_at({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}),
                  CameraIntrinsics{33, 33, 50.0, 50.0, 16.5, 16.5});
  EXPECT_EQ(frame.instance(16, 16), 3);
  EXPECT_NEAR(frame.rgb(16, 16).b, 230, 1);  // 0.9
  EXPECT_NEAR(frame.rgb(16, 16).r, 23, 1);   // 0.1 * 0.9
  EXPECT_NEAR(frame.rgb(16, 16).g, 2, 1);    // 0.01 * 0.9
}

TEST(CpuRenderer, EdgeOnAndTinySurfelsAreNotLost) {
  SurfelCloud cloud;
  Surfel s;
  s.opacity = 0.99F;
  s.position_m = {2.0F, 0.1F, 0.0F};
  s.scale_m = glm::vec2(1e-5F);
  add(cloud, s);
  s.position_m = {2.0F, 0.0F, 0.0F};
  s.scale_m = glm::vec2(0.05F);
  s.R_world_surfel = testing::facing({0.0F, 0.0F, 1.0F});  // In the plane of the eye.
  add(cloud, s);
  const auto scene = shared(cloud);
  const CameraPose pose = core::look_at({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0});
  const CameraIntrinsics camera{64, 64, 100.0, 100.0, 32.5, 32.5};
  const Frame frame = render_with(scene, pose, camera);
  EXPECT_GT(frame.alpha(32, 32), 0.5F);
  EXPECT_NEAR(frame.depth_m(32, 32), 2.0F, 0.2F);
  EXPECT_GT(frame.alpha(27, 32), 0.5F);
  expect_matches_reference(scene, pose, camera);
}

TEST(CpuRenderer, DiscThroughTheCameraIsClippedAtTheNearPlane) {
  SurfelCloud cloud;
  Surfel s;
  s.position_m = {0.6F, 0.0F, -0.2F};
  s.scale_m = {0.8F, 0.5F};
  s.R_world_surfel = testing::facing(glm::normalize(glm::vec3(0.1F, 0.05F, 1.0F)));
  add(cloud, s);
  expect_matches_reference(shared(cloud), core::look_at({0.0, 0.0, 0.0}, {1.0, 0.1, 0.0}),
                           CameraIntrinsics::from_fov(96, 72, 1.5));
}

TEST(CpuRenderer, SurfelsBehindOrTooNearAreNotDrawn) {
  SurfelCloud cloud;
  Surfel s;
  s.R_world_surfel = testing::facing({-1.0F, 0.0F, 0.0F});
  s.position_m = {-1.0F, 0.0F, 0.0F};
  add(cloud, s);
  s.position_m = {0.04F, 0.0F, 0.0F};
  add(cloud, s);
  const Frame frame =
      render_with(shared(cloud), core::look_at({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}), kOddCamera);
  EXPECT_EQ(*std::max_element(frame.alpha.pixels().begin(), frame.alpha.pixels().end()), 0.0F);
  EXPECT_EQ(frame.stats.surfels_projected, 0U);
}

TEST(CpuRenderer, ListsLongerThanTheKeyWindow) {
  // 9000 faint surfels in one tile; each pixel meets a quarter of them.
  core::RandomStream random(8, "long_list");
  SurfelCloud cloud;
  for (int i = 0; i < 9000; ++i) {
    Surfel s;
    const auto uniform = [&](double lo, double hi) {
      return static_cast<float>(random.uniform(lo, hi));
    };
    s.position_m = {uniform(2.0, 3.0), uniform(-0.1, 0.1), uniform(-0.1, 0.1)};
    s.R_world_surfel = testing::facing({-1.0F, 0.0F, 0.0F});
    s.scale_m = glm::vec2(0.06F);
    s.opacity = i > 8500 ? 0.03F : uniform(0.004, 0.006);
    s.semantic = static_cast<std::uint16_t>(random.index(5));
    s.instance = static_cast<std::uint16_t>(random.index(9));
    add(cloud, s);
  }
  const auto scene = shared(std::move(cloud));
  const CameraPose pose = core::look_at({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0});
  const CameraIntrinsics camera{16, 16, 150.0, 150.0, 8.0, 8.0};
  for (const int top_k : {3, 24}) {
    const RenderOptions options{.top_k = top_k, .threads = 1};
    const Frame reference =
        make_reference_renderer(scene, options)->render(pose, camera, Channels::kAll);
    const Frame frame = render_with(scene, pose, camera, options);
    ASSERT_GT(frame.stats.pairs_touched, 8192U);
    const Difference d = compare(frame, reference);
    EXPECT_EQ(d.colour_off, 0);
    // Weights that differ by less than a key resolves change places among thousands.
    EXPECT_LE(d.labels_off, 0.1 * d.labelled);
    EXPECT_GT(d.labelled, 200);
  }
}

void expect_identical(const Frame& a, const Frame& b) {
  EXPECT_EQ(a.rgb.pixels(), b.rgb.pixels());
  EXPECT_EQ(a.alpha.pixels(), b.alpha.pixels());
  EXPECT_EQ(a.normal.pixels(), b.normal.pixels());
  EXPECT_EQ(a.semantic.pixels(), b.semantic.pixels());
  EXPECT_EQ(a.instance.pixels(), b.instance.pixels());
  EXPECT_EQ(a.confidence.pixels(), b.confidence.pixels());
  ASSERT_EQ(a.depth_m.size(), b.depth_m.size());
  for (std::size_t i = 0; i < a.depth_m.size(); ++i) {
    const float x = a.depth_m.pixels()[i], y = b.depth_m.pixels()[i];
    ASSERT_TRUE(x == y || (std::isnan(x) && std::isnan(y)));
  }
  EXPECT_EQ(a.stats.surfels_projected, b.stats.surfels_projected);
  EXPECT_EQ(a.stats.pairs_binned, b.stats.pairs_binned);
  EXPECT_EQ(a.stats.pairs_touched, b.stats.pairs_touched);
  EXPECT_EQ(a.stats.evaluations, b.stats.evaluations);
  EXPECT_EQ(a.stats.contributions, b.stats.contributions);
}

TEST(CpuRenderer, OnlyTheChannelsAskedFor) {
  const auto scene = shared(testing::random_scene(2, 800));
  const CameraPose pose = core::look_at({-4.0, 0.4, 1.0}, {0.0, 0.0, 0.0});
  const auto renderer = make_cpu_renderer(scene, {.threads = 1});
  const Frame all = renderer->render(pose, kOddCamera, Channels::kAll);
  const Frame depth = renderer->render(pose, kOddCamera, Channels::kDepth);
  EXPECT_TRUE(depth.rgb.empty() && depth.normal.empty() && depth.semantic.empty() &&
              depth.instance.empty() && depth.confidence.empty());
  EXPECT_EQ(depth.alpha.pixels(), all.alpha.pixels());
  const Frame colour = renderer->render(pose, kOddCamera, Channels::kRgb);
  EXPECT_TRUE(colour.depth_m.empty());
  EXPECT_EQ(colour.rgb.pixels(), all.rgb.pixels());
  const Frame labels = renderer->render(pose, kOddCamera, Channels::kLabels);
  EXPECT_TRUE(labels.rgb.empty());
  EXPECT_EQ(labels.semantic.pixels(), all.semantic.pixels());
  EXPECT_EQ(labels.confidence.pixels(), all.confidence.pixels());
}

TEST(CpuRenderer, FramesAreReused) {
  const auto renderer = make_cpu_renderer(shared(testing::random_scene(2, 800)), {});
  const CameraPose pose = core::look_at({-4.0, 0.4, 1.0}, {0.0, 0.0, 0.0});
  Frame frame;
  renderer->render(pose, kOddCamera, Channels::kAll, frame);
  const Frame first = frame;
  const auto* rgb = frame.rgb.data();
  const auto* depth = frame.depth_m.data();
  renderer->render(core::look_at({4.0, 0.4, 1.0}, {0.0, 0.0, 0.0}), kOddCamera, Channels::kRgb,
                   frame);
  renderer->render(pose, kOddCamera, Channels::kAll, frame);
  EXPECT_EQ(frame.rgb.data(), rgb);
  EXPECT_EQ(frame.depth_m.data(), depth);
  expect_identical(frame, first);
}

}  // namespace
}  // namespace segsim::renderer
