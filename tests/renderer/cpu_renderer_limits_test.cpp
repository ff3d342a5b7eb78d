/// @file
/// The edges of what the renderer takes: what it refuses, what it draws nothing for, and the
/// smallest and largest images.

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "core/check.h"
#include "core/frames.h"
#include "renderer/cpu_renderer.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer {
namespace {

using core::CameraIntrinsics;
using core::CameraPose;
using core::Channels;
using core::Frame;

constexpr Channels kEverything = Channels::kAll | Channels::kDepthNormal | Channels::kFeatures;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();
const CameraIntrinsics kOddCamera{77, 61, 70.0, 64.0, 36.3, 31.8};

std::shared_ptr<const SurfelCloud> shared(SurfelCloud cloud) {
  return std::make_shared<const SurfelCloud>(std::move(cloud));
}

/// Nothing is seen, in any channel that was asked for.
void expect_void(const Frame& frame, int width_px, int height_px) {
  const auto pixels = static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
  ASSERT_EQ(frame.alpha.size(), pixels);
  ASSERT_EQ(frame.depth_m.size(), pixels);
  ASSERT_EQ(frame.semantic_feature.size(), pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    ASSERT_EQ(frame.alpha.pixels()[i], 0.0F);
    ASSERT_EQ(frame.rgb.pixels()[i].r + frame.rgb.pixels()[i].g + frame.rgb.pixels()[i].b, 0);
    ASSERT_TRUE(std::isnan(frame.depth_m.pixels()[i]));
    ASSERT_EQ(frame.normal.pixels()[i], glm::vec3(0.0F));
    ASSERT_EQ(frame.depth_normal.pixels()[i], glm::vec3(0.0F));
    ASSERT_EQ(frame.semantic.pixels()[i], 0);
    ASSERT_EQ(frame.instance.pixels()[i], 0);
    ASSERT_EQ(frame.confidence.pixels()[i], 0.0F);
    ASSERT_EQ(frame.instance_confidence.pixels()[i], 0.0F);
    ASSERT_EQ(frame.semantic_feature.pixels()[i], core::SemanticFeature{});
    ASSERT_EQ(frame.instance_feature.pixels()[i], core::InstanceFeature{});
  }
  EXPECT_EQ(frame.stats.contributions, 0U);
}

constexpr Compat kPrograms[] = {Compat::kExact, Compat::kInria, Compat::kGsplat};

TEST(CpuRendererLimits, EmptyScene) {
  for (const Compat compat : kPrograms) {
    for (const int top_k : {kAllSurfels, 1, 4, kMaxTopK}) {
      const auto renderer =
          make_cpu_renderer(shared(SurfelCloud{}), {.top_k = top_k, .compat = compat});
      expect_void(renderer->render(CameraPose(), kOddCamera, kEverything), 77, 61);
    }
  }
}

TEST(CpuRendererLimits, NothingInView) {
  SurfelCloud cloud = testing::random_scene(3, 500);
  for (glm::vec3& p : cloud.position_m) p.z -= 10.0F;
  testing::add_random_features(cloud, 4);
  const auto scene = shared(std::move(cloud));
  for (const Compat compat : kPrograms) {
    for (const int top_k : {kAllSurfels, 1, 4, kMaxTopK}) {
      const auto renderer = make_cpu_renderer(scene, {.top_k = top_k, .compat = compat});
      Frame frame;
      // What an earlier view left in the frame must not show.
      renderer->render(core::look_at({0.0, 0.0, -3.0}, {0.0, 0.0, -10.0}), kOddCamera,
                       kEverything, frame);
      EXPECT_GT(frame.stats.contributions, 0U);
      renderer->render(CameraPose(), kOddCamera, kEverything, frame);
      expect_void(frame, 77, 61);
      EXPECT_EQ(frame.stats.pairs_binned, 0U);
      EXPECT_EQ(frame.stats.surfels_projected, 0U);
    }
  }
}

TEST(CpuRendererLimits, SurfelsWithoutLabelsAreVoid) {
  SurfelCloud cloud = testing::random_scene(2, 800);
  cloud.semantic_id.clear();
  cloud.instance_id.clear();
  const Frame frame =
      make_cpu_renderer(shared(std::move(cloud)))
          ->render(core::look_at({-4.0, 0.4, 1.0}, {0.0, 0.0, 0.0}), kOddCamera, kEverything);
  EXPECT_GT(frame.stats.contributions, 0U);
  EXPECT_TRUE(std::all_of(frame.semantic.pixels().begin(), frame.semantic.pixels().end(),
                          [](std::uint16_t id) { return id == 0; }));
  EXPECT_TRUE(std::all_of(frame.confidence.pixels().begin(), frame.confidence.pixels().end(),
                          [](float c) { return c == 0.0F; }));
  EXPECT_TRUE(std::all_of(frame.instance_feature.pixels().begin(),
                          frame.instance_feature.pixels().end(),
                          [](const auto& f) { return f == core::InstanceFeature{}; }));
}

TEST(CpuRendererLimits, OnePixel) {
  SurfelCloud cloud;
  testing::add(cloud, {.position_m = {0.0F, 0.0F, 2.0F}, .opacity = 0.8F});
  const Frame one =
      make_cpu_renderer(shared(cloud))
          ->render(CameraPose(), CameraIntrinsics{1, 1, 1.0, 1.0, 0.5, 0.5}, kEverything);
  ASSERT_EQ(one.alpha.size(), 1U);
  EXPECT_NEAR(one.alpha(0, 0), 0.8F, 1e-4F);
  EXPECT_NEAR(one.depth_m(0, 0), 2.0F, 1e-5F);
  EXPECT_EQ(one.semantic(0, 0), 1);
  EXPECT_EQ(one.depth_normal(0, 0), glm::vec3(0.0F));  // It has no neighbours.
}

TEST(CpuRendererLimits, ImagesOfOneRowOrColumn) {
  SurfelCloud cloud;
  testing::add(cloud, {.position_m = {0.0F, 0.0F, 2.0F}, .scale_m = {0.5F, 0.5F}});
  const auto renderer = make_cpu_renderer(shared(cloud));
  const Frame row =
      renderer->render(CameraPose(), {65535, 1, 9.0, 9.0, 32767.5, 0.5}, Channels::kRgbd);
  EXPECT_NEAR(row.depth_m(32767, 0), 2.0F, 1e-5F);
  const Frame column =
      renderer->render(CameraPose(), {1, 65535, 9.0, 9.0, 0.5, 32767.5}, Channels::kRgbd);
  EXPECT_NEAR(column.depth_m(0, 32767), 2.0F, 1e-5F);
  EXPECT_EQ(row.alpha(0, 0), 0.0F);
  EXPECT_EQ(column.alpha(0, 65534), 0.0F);
}

TEST(CpuRendererLimits, AHundredMillionPixels) {
  SurfelCloud cloud;
  testing::add(cloud, {.position_m = {0.0F, 0.0F, 2.0F}, .opacity = 0.8F});
  const auto renderer = make_cpu_renderer(shared(cloud));
  const CameraIntrinsics large{10000, 10000, 5000.0, 5000.0, 5000.5, 5000.5};
  const auto start = std::chrono::steady_clock::now();
  const Frame frame = renderer->render(CameraPose(), large, Channels::kNone);
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
  ASSERT_EQ(frame.alpha.size(), 100'000'000U);
  EXPECT_NEAR(frame.alpha(5000, 5000), 0.8F, 1e-4F);
  EXPECT_EQ(frame.alpha(9999, 9999), 0.0F);
  EXPECT_EQ(frame.alpha(0, 0), 0.0F);
  EXPECT_LT(elapsed.count(), 60.0);  // 2 s where nothing disturbs it.
  RecordProperty("seconds", std::to_string(elapsed.count()));
}

/// A scene in which one surfel was changed.
SurfelCloud with(const std::function<void(SurfelCloud&, std::size_t)>& change) {
  SurfelCloud cloud = testing::random_scene(2, 10);
  change(cloud, 3);
  return cloud;
}

void expect_refused(const std::function<void(SurfelCloud&, std::size_t)>& change) {
  EXPECT_THROW(static_cast<void>(make_cpu_renderer(shared(with(change)))),
               core::ContractViolation);
}

TEST(CpuRendererLimits, SurfelsOutOfRangeAreRefused) {
  EXPECT_NO_THROW(static_cast<void>(make_cpu_renderer(shared(with([](auto&, auto) {})))));
  for (const float bad : {kNan, kInf, -kInf}) {
    SCOPED_TRACE(bad);
    for (int axis = 0; axis < 3; ++axis) {
      expect_refused([&](SurfelCloud& c, std::size_t i) { c.position_m[i][axis] = bad; });
      expect_refused([&](SurfelCloud& c, std::size_t i) { c.sh[i][axis] = bad; });
    }
    expect_refused([&](SurfelCloud& c, std::size_t i) { c.scale_m[i].x = bad; });
    expect_refused([&](SurfelCloud& c, std::size_t i) { c.scale_m[i].y = bad; });
    expect_refused([&](SurfelCloud& c, std::size_t i) { c.opacity[i] = bad; });
    for (int part = 0; part < 4; ++part) {
      expect_refused([&](SurfelCloud& c, std::size_t i) { c.R_world_surfel[i][part] = bad; });
    }
  }
  for (const float bad : {0.0F, -0.0F, -1.0F}) {
    SCOPED_TRACE(bad);
    expect_refused([&](SurfelCloud& c, std::size_t i) { c.scale_m[i].x = bad; });
    expect_refused([&](SurfelCloud& c, std::size_t i) { c.scale_m[i].y = bad; });
    expect_refused([&](SurfelCloud& c, std::size_t i) { c.opacity[i] = bad; });
  }
  expect_refused([](SurfelCloud& c, std::size_t i) { c.opacity[i] = 1.001F; });
}

TEST(CpuRendererLimits, QuaternionsMustBeOfUnitLength) {
  for (const float length : {0.0F, 0.5F, 0.998F, 1.002F, 2.0F}) {
    SCOPED_TRACE(length);
    expect_refused([&](SurfelCloud& c, std::size_t i) { c.R_world_surfel[i] *= length; });
  }
  // What rounding leaves is taken, and hardly moves the picture.
  const auto exact = shared(with([](auto&, auto) {}));
  const auto rounded =
      shared(with([](SurfelCloud& c, std::size_t i) { c.R_world_surfel[i] *= 1.0001F; }));
  const CameraPose pose = core::look_at({-4.0, 0.4, 1.0}, {0.0, 0.0, 0.0});
  const Frame a = make_cpu_renderer(exact)->render(pose, kOddCamera, Channels::kAll);
  const Frame b = make_cpu_renderer(rounded)->render(pose, kOddCamera, Channels::kAll);
  for (std::size_t i = 0; i < a.alpha.size(); ++i) {
    EXPECT_NEAR(a.alpha.pixels()[i], b.alpha.pixels()[i], 5e-3F);
  }
}

TEST(CpuRendererLimits, ExtremeButValidSurfelsAreDrawn) {
  SurfelCloud cloud;
  const float least = std::numeric_limits<float>::denorm_min();
  testing::add(cloud, {.position_m = {0.0F, 0.0F, 2.0F}, .scale_m = {least, least}});
  testing::add(cloud, {.position_m = {0.0F, 0.0F, 3.0F}, .scale_m = {1e15F, 1e15F}});
  testing::add(cloud, {.position_m = {0.0F, 0.0F, 4.0F}, .scale_m = {1e15F, least}});
  testing::add(cloud, {.position_m = {1e18F, 0.0F, 1e18F}, .scale_m = {1e10F, 1e10F}});
  testing::add(cloud, {.position_m = {0.0F, 0.0F, -1e18F}, .scale_m = {1.0F, 1.0F}});
  const Frame frame = make_cpu_renderer(shared(std::move(cloud)))
                          ->render(CameraPose(), kOddCamera, Channels::kAll);
  for (const float alpha : frame.alpha.pixels()) {
    ASSERT_TRUE(alpha >= 0.0F && alpha <= 1.0F) << alpha;
  }
  // The second fills the image.
  EXPECT_GT(frame.alpha(3, 3), 0.8F);
  EXPECT_NEAR(frame.depth_m(3, 3), 3.0F, 1e-3F);
}

TEST(CpuRendererLimits, OptionsOutOfRangeAreRefused) {
  const auto scene = shared(testing::random_scene(2, 10));
  EXPECT_THROW(static_cast<void>(make_cpu_renderer(nullptr)), core::ContractViolation);
  for (const RenderOptions& options :
       {RenderOptions{.top_k = -1}, RenderOptions{.top_k = kMaxTopK + 1},
        RenderOptions{.near_m = 0.0F}, RenderOptions{.near_m = kNan},
        RenderOptions{.near_m = kInf}, RenderOptions{.threads = -1}}) {
    EXPECT_THROW(static_cast<void>(make_cpu_renderer(scene, options)),
                 core::ContractViolation);
  }
  SurfelCloud short_of_one = *scene;
  short_of_one.opacity.pop_back();
  EXPECT_THROW(static_cast<void>(make_cpu_renderer(shared(short_of_one))),
               core::ContractViolation);
}

void expect_refused(const CameraPose& pose, const CameraIntrinsics& camera) {
  const auto renderer = make_cpu_renderer(shared(testing::random_scene(2, 10)));
  EXPECT_THROW(static_cast<void>(renderer->render(pose, camera, Channels::kAll)),
               core::ContractViolation);
}

TEST(CpuRendererLimits, CamerasOutOfRangeAreRefused) {
  expect_refused(CameraPose(), CameraIntrinsics{});
  std::vector<CameraIntrinsics> bad(8, kOddCamera);
  bad[0].width_px = 0, bad[1].height_px = -1;
  bad[2].width_px = 65536, bad[3].height_px = 65536;
  bad[4].fx_px = 0.0, bad[5].fy_px = 0.0;
  bad[6].fx_px = -1.0, bad[7].fy_px = -1.0;
  for (std::size_t i = 0; i < bad.size(); ++i) {
    SCOPED_TRACE(i);
    expect_refused(CameraPose(), bad[i]);
  }
}

TEST(CpuRendererLimits, CamerasThatAreNotFiniteAreRefused) {
  for (const double bad : {std::nan(""), static_cast<double>(INFINITY)}) {
    SCOPED_TRACE(bad);
    for (double CameraIntrinsics::*number :
         {&CameraIntrinsics::fx_px, &CameraIntrinsics::fy_px, &CameraIntrinsics::cx_px,
          &CameraIntrinsics::cy_px}) {
      CameraIntrinsics camera = kOddCamera;
      camera.*number = bad;
      expect_refused(CameraPose(), camera);
    }
    for (int axis = 0; axis < 3; ++axis) {
      glm::dvec3 at(0.0);
      at[axis] = bad;
      expect_refused(CameraPose(glm::dquat(1.0, 0.0, 0.0, 0.0), at), kOddCamera);
    }
    for (int part = 0; part < 4; ++part) {
      glm::dquat rotation(1.0, 0.0, 0.0, 0.0);
      rotation[part] = bad;
      expect_refused(CameraPose(rotation, glm::dvec3(0.0)), kOddCamera);
    }
  }
}

}  // namespace
}  // namespace segsim::renderer
