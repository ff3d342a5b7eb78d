#pragma once

#include <cstdint>
#include <filesystem>

#include "core/image.h"

namespace segsim::perception {

/// A larger picture is refused before it is decoded: 400 MB as RGB.
inline constexpr std::int64_t kMaxImagePixels = std::int64_t{1} << 27;

/// Reads an 8-bit PNG or JPEG; grey becomes RGB, alpha is dropped.
/// @throws core::InputError if it cannot be read or is too large.
[[nodiscard]] core::Image<core::Rgb8> read_image(const std::filesystem::path& file);

/// Writes a PNG or JPEG (by extension), atomically. @param jpeg_quality  1 to 100.
void write_image(const std::filesystem::path& file, const core::Image<core::Rgb8>& image,
                 int jpeg_quality = 95);

}  // namespace segsim::perception
