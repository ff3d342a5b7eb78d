#pragma once

/// @file
/// Pixels in host memory. x right, y down; pixel (x, y) has its centre at (x + 0.5, y + 0.5).

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/check.h"

namespace segsim::core {

struct Rgb8 {
  std::uint8_t r = 0, g = 0, b = 0;  ///< sRGB.
  bool operator==(const Rgb8&) const = default;
};

/// Row-major, no row padding.
template <class Pixel>
class Image {
 public:
  Image() = default;
  Image(int width_px, int height_px, Pixel fill = {})
      : width_px_(width_px), height_px_(height_px) {
    SEGSIM_CHECK(width_px >= 0 && height_px >= 0, "negative image size");
    pixels_.assign(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px),
                   fill);
  }

  /// Sets the size and keeps the allocation when it suffices; pixel values are unspecified.
  void resize(int width_px, int height_px) {
    width_px_ = width_px;
    height_px_ = height_px;
    pixels_.resize(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px));
  }

  [[nodiscard]] int width_px() const { return width_px_; }
  [[nodiscard]] int height_px() const { return height_px_; }
  [[nodiscard]] std::size_t size() const { return pixels_.size(); }
  [[nodiscard]] bool empty() const { return pixels_.empty(); }
  [[nodiscard]] bool contains(int x, int y) const {
    return x >= 0 && y >= 0 && x < width_px_ && y < height_px_;
  }

  Pixel& operator()(int x, int y) { return pixels_[index(x, y)]; }
  const Pixel& operator()(int x, int y) const { return pixels_[index(x, y)]; }
  Pixel* row(int y) { return pixels_.data() + index(0, y); }
  const Pixel* row(int y) const { return pixels_.data() + index(0, y); }
  Pixel* data() { return pixels_.data(); }
  const Pixel* data() const { return pixels_.data(); }
  std::vector<Pixel>& pixels() { return pixels_; }
  const std::vector<Pixel>& pixels() const { return pixels_; }

 private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_px_) +
           static_cast<std::size_t>(x);
  }

  int width_px_ = 0, height_px_ = 0;
  std::vector<Pixel> pixels_;
};

}  // namespace segsim::core
