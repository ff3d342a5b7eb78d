#pragma once

/// @file
/// Fits an image of any size into the network's input, a square for the networks of this
/// program. Training, evaluation and
/// navigation all use this one function, so a box means the same pixels everywhere.

#include "core/image.h"
#include "core/stages.h"

namespace segsim::perception {

/// Grey of the bars beside the image.
inline constexpr std::uint8_t kLetterboxGrey = 114;

/// Where the image lies in the input: x_input = x_image * scale_x + offset_x_px.
struct Letterbox {
  int width_px = 0, height_px = 0;  ///< Of the input.
  int image_width_px = 0, image_height_px = 0;
  int offset_x_px = 0, offset_y_px = 0;  ///< Bars at the left and the top.
  double scale_x = 1.0, scale_y = 1.0;   ///< Equal up to the rounding of the size.

  /// All sizes > 0.
  [[nodiscard]] static Letterbox fit(int image_width_px, int image_height_px, int width_px,
                                     int height_px);
  /// Into a square.
  [[nodiscard]] static Letterbox fit(int image_width_px, int image_height_px, int side_px) {
    return fit(image_width_px, image_height_px, side_px, side_px);
  }
  /// Of the image in the input.
  [[nodiscard]] int scaled_width_px() const;
  [[nodiscard]] int scaled_height_px() const;
  [[nodiscard]] core::BoxPx to_square(const core::BoxPx& image_box) const;
  /// Inverse of to_square, cut at the image's borders.
  [[nodiscard]] core::BoxPx to_image(const core::BoxPx& square_box) const;
};

/// The image scaled (area average when shrinking, bilinear when growing) onto grey.
[[nodiscard]] core::Image<core::Rgb8> letterbox(const core::Image<core::Rgb8>& image,
                                                const Letterbox& fit);

}  // namespace segsim::perception
