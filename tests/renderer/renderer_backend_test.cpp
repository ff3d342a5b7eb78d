/// @file
/// The choice of a renderer, on machines with and without a GPU.

#include "renderer/renderer_backend.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/error.h"
#include "renderer/cpu_renderer.h"
#include "renderer/cuda/gpu_error.h"
#include "renderer/scene/room_scene.h"

namespace segsim::renderer {
namespace {

std::shared_ptr<const SurfelCloud> small_room() {
  return std::make_shared<const SurfelCloud>(make_room_scene({.surfel_count = 2000}));
}

/// Why this machine cannot draw on a GPU; none if it can.
std::optional<std::string> obstacle() {
  try {
    (void)make_renderer(Backend::kCuda, small_room());
  } catch (const core::InputError& error) {
    return error.what();
  }
  return std::nullopt;
}

TEST(RendererBackend, WordsNameBackends) {
  for (const Backend backend : {Backend::kAuto, Backend::kCpu, Backend::kCuda}) {
    EXPECT_EQ(backend_of(backend_name(backend)), backend);
  }
  EXPECT_THROW((void)backend_of("gpu"), core::InputError);
  EXPECT_THROW((void)backend_of(""), core::InputError);
}

TEST(RendererBackend, AnObstacleIsOneLineThatSaysWhatWasExpected) {
  const std::optional<std::string> reason = obstacle();
  if (!reason) GTEST_SKIP() << "this machine has a GPU";
  EXPECT_THAT(*reason, testing::HasSubstr("GPU"));
  EXPECT_THAT(*reason, testing::HasSubstr("expected"));
  EXPECT_THAT(*reason, testing::Not(testing::HasSubstr("\n")));
}

TEST(RendererBackend, AutoFallsBackToTheProcessorWithOneWarning) {
  const std::optional<std::string> reason = obstacle();
  if (!reason) GTEST_SKIP() << "this machine has a GPU";
  const auto room = small_room();
  std::vector<std::string> warnings;
  const auto renderer = make_renderer(Backend::kAuto, room, {}, nullptr,
                                      [&](const std::string& w) { warnings.push_back(w); });
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_THAT(warnings[0], testing::HasSubstr(*reason));

  const core::CameraPose pose = room_camera_ring(1).front();
  const core::CameraIntrinsics camera = room_camera(96, 64);
  const core::Frame frame = renderer->render(pose, camera, core::Channels::kAll);
  const core::Frame expected =
      make_cpu_renderer(room)->render(pose, camera, core::Channels::kAll);
  EXPECT_EQ(frame.rgb.pixels(), expected.rgb.pixels());
  EXPECT_EQ(frame.instance.pixels(), expected.instance.pixels());
}

TEST(RendererBackend, TheProcessorNeedsNoWarning) {
  const auto renderer = make_renderer(Backend::kCpu, small_room(), {}, nullptr,
                                      [](const std::string& w) { FAIL() << w; });
  core::Frame frame;
  draw_in_place(*renderer, room_camera_ring(1).front(), room_camera(32, 32),
                core::Channels::kDepth, frame);
  EXPECT_EQ(frame.depth_m.size(), 32U * 32U);
}

}  // namespace
}  // namespace segsim::renderer
