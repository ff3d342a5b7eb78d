#pragma once

/// @file
/// How mesh importers come to the pixels of textures. Decoding image files takes OpenCV's
/// codecs, which load GDAL and more than a hundred other libraries; who looks at shapes alone
/// goes without.

#include <filesystem>
#include <span>

#include "core/image.h"

namespace segsim::worlds {

class TextureReader {
 public:
  TextureReader() = default;
  virtual ~TextureReader() = default;
  TextureReader(const TextureReader&) = delete;
  TextureReader& operator=(const TextureReader&) = delete;

  /// Empty if the file is no image.
  [[nodiscard]] virtual core::Image<core::Rgb8> from_file(
      const std::filesystem::path& file) const = 0;
  /// The same for the bytes of an image file.
  [[nodiscard]] virtual core::Image<core::Rgb8> from_bytes(
      std::span<const unsigned char> bytes) const = 0;
  /// True if textures would be painted in vain.
  [[nodiscard]] virtual bool is_blank() const { return false; }
};

/// Every format that OpenCV reads.
[[nodiscard]] const TextureReader& image_textures();
/// One white pixel for each texture, whatever it shows.
[[nodiscard]] const TextureReader& blank_textures();

}  // namespace segsim::worlds
