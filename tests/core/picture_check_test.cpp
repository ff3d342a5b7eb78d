#include "core/pictures/picture_check.h"

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/pictures/ply_check.h"
#include "tests/error_message.h"

namespace segsim::core {
namespace {

using ::testing::HasSubstr;
using tests::input_error_of;

std::string bytes_of(std::initializer_list<int> values) {
  std::string bytes;
  for (const int value : values) bytes += static_cast<char>(value);
  return bytes;
}

/// A JPEG of 3 x 2 pixels as far as its markers go. A thumbnail in the application's segment
/// has an end marker of its own, and so has a comment between two scans.
std::string small_jpeg() {
  return bytes_of({0xFF, 0xD8,                                      // Start.
                   0xFF, 0xE1, 0,    6,    0xFF, 0xD8, 0xFF, 0xD9,  // Thumbnail.
                   0xFF, 0xFF, 0xC2, 0,    11,   8,    0,    2,    0,  3,
                   1,    1,    17,   0,  // Frame, with filling.
                   0xFF, 0xDA, 0,    8,    1,    1,    0,    0,    63, 0,  // Scan,
                   0x12, 0xFF, 0x00, 0x34, 0xFF, 0xD0, 0x56,  // its data, a restart.
                   0xFF, 0xFE, 0,    4,    0xFF, 0xD9,        // Comment.
                   0xFF, 0xDA, 0,    8,    1,    1,    0,    0,    63, 0,  // Second scan.
                   0x78, 0x9A, 0xFF, 0xD9});
}

TEST(PictureCheck, EveryTruncationOfAJpegIsRefused) {
  const std::string whole = small_jpeg();
  const PictureSize size = check_picture(whole, "a.jpg");
  EXPECT_EQ(size.width_px, 3);
  EXPECT_EQ(size.height_px, 2);
  EXPECT_EQ(check_picture(whole + "what some phones append", "a.jpg").width_px, 3);
  for (std::size_t bytes = 0; bytes < whole.size(); ++bytes) {
    EXPECT_NE(input_error_of([&] { (void)check_picture(whole.substr(0, bytes), "a.jpg"); }),
              "no error")
        << bytes;
  }
  EXPECT_THAT(input_error_of([&] { (void)check_picture(whole.substr(0, 50), "a.jpg"); }),
              HasSubstr("a.jpg: expected a complete JPEG file"));
}

/// A frame of 65535 x 65535 pixels needs 60 bytes.
TEST(PictureCheck, SizesBeyondMemoryAreRefused) {
  std::string large = small_jpeg();
  const std::size_t at = large.find(bytes_of({0xC2}));
  for (std::size_t k = 0; k < 4; ++k) large[at + 4 + k] = static_cast<char>(0xFF);
  EXPECT_THAT(input_error_of([&] { (void)check_picture(large, "a.jpg"); }),
              HasSubstr("found 65535 x 65535"));
}

TEST(PictureCheck, OtherFilesAreNoPictures) {
  for (const std::string& text :
       {std::string(), std::string("GIF89a"), std::string("P6 1 1")}) {
    EXPECT_FALSE(is_png_or_jpeg(text));
    EXPECT_THAT(input_error_of([&] { (void)check_picture(text, "a.gif"); }),
                HasSubstr("a.gif: expected a PNG or JPEG image"));
  }
}

const std::string kTriangle =
    "ply\r\nformat ascii 1.0\ncomment by hand\nelement vertex 3\nproperty float x\n"
    "property float64 y\nelement face 1\nproperty list uchar int vertex_indices\n"
    "end_header\n0 1e-50\n+1 nan\n-inf 1\n3 0 1 2\n";

TEST(PlyCheck, WholeFilesAreTaken) {
  EXPECT_NO_THROW(check_ply(kTriangle, "a.ply"));
  const std::string binary =
      "ply\nformat binary_big_endian 1.0\nelement face 1\nproperty list ushort char i\n"
      "end_header\n" +
      bytes_of({0, 2, 5, 6});
  EXPECT_NO_THROW(check_ply(binary, "a.ply"));
  EXPECT_THAT(input_error_of([&] { check_ply(binary.substr(0, binary.size() - 1), "a.ply"); }),
              HasSubstr("a.ply: expected all bytes of a PLY file"));
}

TEST(PlyCheck, EveryTruncationIsRefused) {
  for (std::size_t bytes = 0; bytes + 2 < kTriangle.size(); ++bytes) {
    EXPECT_NE(input_error_of([&] { check_ply(kTriangle.substr(0, bytes), "a.ply"); }),
              "no error")
        << bytes;
  }
}

TEST(PlyCheck, WhatIsWrongIsNamed) {
  const auto error_with = [](const std::string& from, const std::string& to) {
    std::string text = kTriangle;
    text.replace(text.find(from), from.size(), to);
    return input_error_of([&] { check_ply(text, "a.ply"); });
  };
  EXPECT_THAT(error_with("vertex 3", "vertex -3"), HasSubstr("a number of elements"));
  EXPECT_THAT(error_with("vertex 3", "vertex 99999999999"), HasSubstr("found \"the end"));
  EXPECT_THAT(error_with("float x", "real x"), HasSubstr("a type of a PLY property"));
  EXPECT_THAT(error_with("list uchar", "list float"), HasSubstr("whole number of entries"));
  EXPECT_THAT(error_with("3 0 1 2", "x 0 1 2"), HasSubstr("found \"x\""));
  EXPECT_THAT(error_with("+1 nan", "+1 1,5"), HasSubstr("expected a number, found \"1,5\""));
  EXPECT_THAT(error_with("format ascii 1.0\n", ""), HasSubstr("a PLY header with a format"));
  EXPECT_THAT(error_with("end_header", "element vertex 0\nend_header"),
              HasSubstr("expected each element once, found \"vertex\""));
}

}  // namespace
}  // namespace segsim::core
