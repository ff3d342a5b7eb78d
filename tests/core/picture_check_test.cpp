#include "core/pictures/picture_check.h"

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

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

}  // namespace
}  // namespace segsim::core
