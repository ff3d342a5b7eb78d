#pragma once

/// @file
/// Binary shapes in an image and the operations that spoil them.

#include <opencv2/core.hpp>

#include "core/random.h"

namespace segsim::worlds::internal {

/// Pixels set in a box of the image. Everything outside of the box is not set.
struct Shape {
  cv::Rect box;   ///< Inside the image.
  cv::Mat1b set;  ///< Size of the box; 255 or 0.

  [[nodiscard]] int area_px() const;
};

/// The same pixels in a box that is larger by `margin_px`, cut off at the image's border.
[[nodiscard]] Shape padded(const Shape& shape, int margin_px, const cv::Size& image);
/// The same pixels in a box that holds `box` too.
[[nodiscard]] Shape widened(const Shape& shape, const cv::Rect& box);

/// Moves the border outwards by shift_px + a smooth random field of sigma wobble_px; its
/// correlation falls off over `length_px`.
[[nodiscard]] Shape with_moved_border(const Shape& shape, double shift_px, double wobble_px,
                                      double length_px, const cv::Size& image,
                                      core::RandomStream& random);

/// A random ellipse, centred on one of the set pixels, of area `area_px` inside the image.
/// @param where  At least one pixel set.
[[nodiscard]] Shape random_blob(const Shape& where, double area_px, const cv::Size& image,
                                core::RandomStream& random);

/// Pixels just outside of the shape, up to `width_px` away.
[[nodiscard]] Shape ring_around(const Shape& shape, int width_px, const cv::Size& image);

[[nodiscard]] Shape united(const Shape& a, const Shape& b);
[[nodiscard]] Shape without(const Shape& a, const Shape& b);
[[nodiscard]] Shape common(const Shape& a, const Shape& b);

/// Intersection over union; 0 if both are empty.
[[nodiscard]] double iou(const Shape& a, const Shape& b);

/// The part on one side of a random straight line that leaves a share in [0.25, 0.75] there.
[[nodiscard]] Shape random_part(const Shape& shape, core::RandomStream& random);

}  // namespace segsim::worlds::internal
