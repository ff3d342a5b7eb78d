#pragma once

#include <cstdint>
#include <filesystem>

#include "core/image.h"

namespace segsim::perception {

/// Reads an 8-bit PNG or JPEG; grey becomes RGB, alpha is dropped.
/// @throws core::InputError if it cannot be read or has more than core::kMostPixels pixels.
[[nodiscard]] core::Image<core::Rgb8> read_image(const std::filesystem::path& file);

/// Writes a PNG or JPEG (by extension), atomically. @param jpeg_quality  1 to 100.
void write_image(const std::filesystem::path& file, const core::Image<core::Rgb8>& image,
                 int jpeg_quality = 95);

}  // namespace segsim::perception
