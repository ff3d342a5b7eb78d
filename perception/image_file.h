#pragma once

#include <filesystem>

#include "core/image.h"

namespace segsim::perception {

/// Reads an 8-bit PNG or JPEG; grey becomes RGB, alpha is dropped.
/// @throws core::InputError if it cannot be read.
[[nodiscard]] core::Image<core::Rgb8> read_image(const std::filesystem::path& file);

/// Writes a PNG or JPEG (by extension), atomically.
void write_image(const std::filesystem::path& file, const core::Image<core::Rgb8>& image);

}  // namespace segsim::perception
