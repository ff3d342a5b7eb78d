#pragma once

/// @file
/// What tests of OpenEXR files share: a folder per test, frames, and messages of errors.

#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>

#include "core/error.h"
#include "renderer/files/exr_io.h"
#include "tests/error_message.h"
#include "tests/renderer/files/recorded_frames.h"

namespace segsim::renderer::testing {

namespace fs = std::filesystem;

class ExrFolder : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::path(::testing::TempDir()) / (std::string("exr_") + info->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    file_ = folder_ / "view.exr";
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_, file_;
};

inline std::string read_error(const fs::path& file) {
  return tests::input_error_of([&] { (void)read_frame_exr(file); });
}

inline FrameInfo flat_info() {
  auto names = std::make_shared<SceneNames>();
  names->classes.add(1, "wall");
  names->classes.add(2, "couch");
  names->instances.add(257, "couch_a");
  FrameInfo info;
  info.time_ns = 9'007'199'254'740'993;  // Not a double.
  info.scene = "flat";
  info.scene_sha256 = "0123abcd";
  info.names = names;
  return info;
}

}  // namespace segsim::renderer::testing
