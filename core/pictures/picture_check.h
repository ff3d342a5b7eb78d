#pragma once

/// @file
/// Whether a PNG or JPEG file is whole, without decoding it. Decoders fill what is missing
/// with grey and say nothing: a recording or a data set that was cut short would be measured
/// as if it were whole.

#include <string>
#include <string_view>

namespace segsim::core {

struct PictureSize {
  int width_px = 0, height_px = 0;
};

/// @param place  For messages: the file.
/// @throws InputError unless `bytes` are a whole PNG (all chunks with their checksums, the end
///     chunk) or JPEG (segments and scans up to the end marker; what follows it is ignored),
///     with a size in 1 ... core::kMostPixels pixels.
[[nodiscard]] PictureSize check_picture(std::string_view bytes, const std::string& place);

/// Whether the bytes begin as those of a PNG or JPEG file do.
[[nodiscard]] bool is_png_or_jpeg(std::string_view bytes);

}  // namespace segsim::core
