#include "renderer/exr_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/error.h"

namespace segsim::renderer {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class ExrIo : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::path(::testing::TempDir()) / (std::string("exr_io_") + info->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_;
};

/// Every byte value of colour, ids up to 65535 and a NaN.
core::Frame full_frame() {
  core::Frame frame;
  frame.intrinsics = {16, 16, 20.5, 21.25, 8.125, 7.75};
  frame.T_world_camera = core::look_at({1.0, 2.0, 1.5}, {3.0, -1.0, 0.5});
  frame.rgb = core::Image<core::Rgb8>(16, 16);
  frame.alpha = frame.depth_m = frame.confidence = core::Image<float>(16, 16);
  frame.normal = core::Image<glm::vec3>(16, 16);
  frame.semantic = frame.instance = core::Image<std::uint16_t>(16, 16);
  for (int i = 0; i < 256; ++i) {
    const auto byte = static_cast<std::uint8_t>(i);
    frame.rgb.pixels()[i] = {byte, static_cast<std::uint8_t>(255 - i), 7};
    const auto x = static_cast<float>(i);
    frame.alpha.pixels()[i] = x / 255.0F;
    frame.depth_m.pixels()[i] = i == 17 ? std::numeric_limits<float>::quiet_NaN() : 0.01F * x;
    frame.confidence.pixels()[i] = 1.0F - x / 255.0F;
    frame.normal.pixels()[i] = glm::normalize(glm::vec3(x, 1.0F, -2.0F));
    frame.semantic.pixels()[i] = byte;
    frame.instance.pixels()[i] = static_cast<std::uint16_t>(257 * i);
  }
  return frame;
}

TEST_F(ExrIo, FrameRoundTrip) {
  const core::Frame frame = full_frame();
  write_frame_exr(folder_ / "view.exr", frame);
  const core::Frame back = read_frame_exr(folder_ / "view.exr");
  EXPECT_EQ(back.rgb.pixels(), frame.rgb.pixels());
  EXPECT_EQ(back.alpha.pixels(), frame.alpha.pixels());
  EXPECT_EQ(back.normal.pixels(), frame.normal.pixels());
  EXPECT_EQ(back.semantic.pixels(), frame.semantic.pixels());
  EXPECT_EQ(back.instance.pixels(), frame.instance.pixels());
  EXPECT_EQ(back.confidence.pixels(), frame.confidence.pixels());
  for (std::size_t i = 0; i < frame.depth_m.size(); ++i) {
    const float a = frame.depth_m.pixels()[i], b = back.depth_m.pixels()[i];
    EXPECT_TRUE(a == b || (std::isnan(a) && std::isnan(b))) << i;
  }
  EXPECT_EQ(back.intrinsics.width_px, 16);
  EXPECT_EQ(back.intrinsics.fx_px, 20.5);
  EXPECT_EQ(back.intrinsics.fy_px, 21.25);
  EXPECT_EQ(back.intrinsics.cx_px, 8.125);
  EXPECT_EQ(back.intrinsics.cy_px, 7.75);
  const core::Point<core::frame::Camera> p{{0.3, -0.2, 2.0}};
  EXPECT_LT(glm::length((back.T_world_camera * p).xyz_m - (frame.T_world_camera * p).xyz_m),
            1e-6);
}

TEST_F(ExrIo, AbsentImagesStayAbsent) {
  core::Frame frame = full_frame();
  frame.rgb = {};
  frame.normal = {};
  frame.semantic = {};
  write_frame_exr(folder_ / "view.exr", frame);
  const core::Frame back = read_frame_exr(folder_ / "view.exr");
  EXPECT_TRUE(back.rgb.empty());
  EXPECT_TRUE(back.normal.empty());
  EXPECT_TRUE(back.semantic.empty());
  EXPECT_FALSE(back.depth_m.empty());
}

TEST_F(ExrIo, DepthRoundTripAndFromAFrame) {
  const core::Frame frame = full_frame();
  write_depth_exr(folder_ / "depth.exr", frame.depth_m);
  write_frame_exr(folder_ / "view.exr", frame);
  for (const char* name : {"depth.exr", "view.exr"}) {
    const core::Image<float> back = read_depth_exr(folder_ / name);
    EXPECT_EQ(back.width_px(), 16);
    EXPECT_EQ(back(3, 2), frame.depth_m(3, 2));
    EXPECT_TRUE(std::isnan(back(1, 1)));
  }
}

template <class Action>
std::string error_of(const Action& action) {
  try {
    action();
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST_F(ExrIo, BadFilesAreRefusedByName) {
  const fs::path file = folder_ / "view.exr";
  EXPECT_THAT(error_of([&] { static_cast<void>(read_depth_exr(file)); }),
              HasSubstr("view.exr"));
  std::ofstream(file) << "this is no image";
  EXPECT_THAT(error_of([&] { static_cast<void>(read_frame_exr(file)); }),
              HasSubstr("view.exr"));

  core::Frame frame = full_frame();
  frame.depth_m = {};
  write_frame_exr(file, frame);
  EXPECT_THAT(error_of([&] { static_cast<void>(read_depth_exr(file)); }),
              HasSubstr("expected channel Z"));
  write_depth_exr(file, full_frame().depth_m);
  EXPECT_THAT(error_of([&] { static_cast<void>(read_frame_exr(file)); }),
              HasSubstr("expected attribute fx_px"));
}

TEST_F(ExrIo, TruncatedFileIsRefused) {
  const fs::path file = folder_ / "view.exr";
  write_frame_exr(file, full_frame());
  fs::resize_file(file, fs::file_size(file) / 2);
  EXPECT_THROW(static_cast<void>(read_frame_exr(file)), core::InputError);
}

TEST_F(ExrIo, ImagesOfDifferentSizesAreAProgrammingError) {
  core::Frame frame = full_frame();
  frame.alpha = core::Image<float>(8, 16);
  EXPECT_THROW(write_frame_exr(folder_ / "view.exr", frame), core::ContractViolation);
  EXPECT_FALSE(fs::exists(folder_ / "view.exr"));
}

}  // namespace
}  // namespace segsim::renderer
