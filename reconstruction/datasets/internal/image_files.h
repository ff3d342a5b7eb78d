#pragma once

/// @file
/// Image files of RGB-D recordings. OpenCV returns a partly filled picture for a file that
/// ends early, so files are checked by their structure first: PNG chunks with their checksums,
/// JPEG markers.

#include <cstdint>
#include <filesystem>

#include "core/image.h"

namespace segsim::reconstruction::internal {

struct ImageSize {
  int width_px = 0, height_px = 0;
  bool operator==(const ImageSize&) const = default;
};

/// Walks the whole file without decoding it.
/// @throws InputError if it cannot be read, is neither PNG nor JPEG, ends early, or (PNG) has
/// a chunk whose checksum is wrong.
[[nodiscard]] ImageSize check_image_file(const std::filesystem::path& file);

/// Any 8-bit picture, as sRGB.
[[nodiscard]] core::Image<core::Rgb8> read_color_image(const std::filesystem::path& file);
/// 16-bit PNG of depths; 0 and 65535 mean "no measurement".
/// @param unit_m  Metres per count: 0.001 for millimetres.
[[nodiscard]] core::Image<float> read_depth_image(const std::filesystem::path& file,
                                                  double unit_m);
/// 8- or 16-bit PNG with one channel.
[[nodiscard]] core::Image<std::uint16_t> read_id_image(const std::filesystem::path& file);

}  // namespace segsim::reconstruction::internal
