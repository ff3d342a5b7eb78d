#pragma once

/// @file
/// Pictures that need no library: binary PPM files, which most image viewers and converters
/// read.

#include <filesystem>

#include <glm/vec2.hpp>

#include "core/file_io.h"
#include "core/image.h"

namespace examples {

/// @throws segsim::core::InputError if the file cannot be written.
inline void write_ppm(const std::filesystem::path& file,
                      const segsim::core::Image<segsim::core::Rgb8>& image) {
  segsim::core::write_file_atomically(file, [&image](std::ostream& out) {
    out << "P6\n" << image.width_px() << ' ' << image.height_px() << "\n255\n";
    for (const segsim::core::Rgb8& pixel : image.pixels()) {
      out << static_cast<char>(pixel.r) << static_cast<char>(pixel.g)
          << static_cast<char>(pixel.b);
    }
  });
}

/// A map seen from above is drawn with north up: row 0 of a picture is the largest y.
inline void paint(segsim::core::Image<segsim::core::Rgb8>& image, const glm::ivec2& cell,
                  int radius_px, const segsim::core::Rgb8& colour) {
  for (int dy = -radius_px; dy <= radius_px; ++dy) {
    for (int dx = -radius_px; dx <= radius_px; ++dx) {
      const int x = cell.x + dx;
      const int y = image.height_px() - 1 - (cell.y + dy);
      if (image.contains(x, y)) image(x, y) = colour;
    }
  }
}

}  // namespace examples
