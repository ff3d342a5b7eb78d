#include "core/camera_path.h"

#include <filesystem>
#include <string>

#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"

namespace segsim::core {
namespace {

using ::testing::HasSubstr;

class CameraPathFile : public ::testing::Test {
 protected:
  ~CameraPathFile() override { std::filesystem::remove(file_); }
  [[nodiscard]] std::string error_of(const std::string& text) const {
    write_file_atomically(file_, [&](std::ostream& out) { out << text; });
    try {
      (void)read_camera_path(file_);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  std::filesystem::path file_ =
      std::filesystem::path(::testing::TempDir()) /
      (std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()) +
       std::to_string(::getpid()) + ".txt");
};

TEST_F(CameraPathFile, ComesBackToTheLastBit) {
  const CameraPath path{{640, 480, 501.25, 500.1, 320.5, 240.0},
                        {{CameraPose({0.6, 0.0, 0.8, 0.0}, {0.1, -2.0, 1.0 / 3.0}), "00003"},
                         {CameraPose({1.0, 0.0, 0.0, 0.0}, {1e-9, 2.0, 3.0}), "a name"}}};
  write_camera_path(file_, path);
  const CameraPath read = read_camera_path(file_);
  EXPECT_EQ(read.intrinsics.width_px, 640);
  EXPECT_EQ(read.intrinsics.fy_px, 500.1);
  ASSERT_EQ(read.views.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(read.views[i].frame, path.views[i].frame);
    EXPECT_EQ(read.poses()[i].translation_m(), path.poses()[i].translation_m());
    EXPECT_EQ(read.poses()[i].rotation(), path.poses()[i].rotation());
  }
}

TEST_F(CameraPathFile, SaysWhichLineIsWrong) {
  const std::string head = "segsim cameras 1\nintrinsics 64 48 50 50 32 24\n";
  EXPECT_EQ(error_of(head), "no error");
  EXPECT_THAT(error_of(""), HasSubstr(":1: expected segsim cameras 1"));
  EXPECT_THAT(error_of("segsim cameras 1\n"), HasSubstr(":2: expected intrinsics"));
  EXPECT_THAT(error_of("segsim cameras 1\nintrinsics 64 48 50 -50 32 24\n"),
              HasSubstr("focal lengths above 0"));
  EXPECT_THAT(error_of(head + "1 2 3 0 0 0 1 f\n1 2 nan 0 0 0 1 f\n"),
              HasSubstr(":4: expected a finite number"));
  EXPECT_THAT(error_of(head + "1 2 3 0 0 0\n"), HasSubstr(":3: expected a finite number"));
  EXPECT_THAT(error_of(head + "1 2 3 0 0 0 2 f\n"), HasSubstr("a unit quaternion"));
}

}  // namespace
}  // namespace segsim::core
