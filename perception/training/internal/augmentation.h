#pragma once

/// @file
/// What training does to a picture and its boxes before each use: mosaic (four pictures in
/// one, Bochkovskiy et al. 2020, "YOLOv4"), shift, scale, flip and colour. training.h has the
/// ranges.

#include <array>
#include <vector>

#include "core/image.h"
#include "core/random.h"
#include "perception/data/labeled_box.h"
#include "perception/training/training.h"

namespace segsim::perception {

/// A letterboxed picture.
struct Sample {
  core::Image<core::Rgb8> square;
  std::vector<LabeledBox> boxes;  ///< Pixels of the square.
  core::BoxPx content;            ///< The square without its bars, whole pixels.
};

/// From a square of `from_px` to one of `to_px`: x_out = scale * (x - from / 2) + to / 2 +
/// shift, mirrored afterwards if `flip`.
struct Warp {
  int from_px = 0, to_px = 0;
  double scale = 1.0, shift_x_px = 0.0, shift_y_px = 0.0;
  bool flip = false;

  /// Cut at the square's borders: without area if it is outside.
  [[nodiscard]] core::BoxPx apply(const core::BoxPx& box) const;
  /// Bilinear; grey where nothing is.
  [[nodiscard]] core::Image<core::Rgb8> apply(const core::Image<core::Rgb8>& image) const;
};

/// @param from_px  Side of what is warped: that of the picture or of its mosaic.
[[nodiscard]] Warp draw_warp(core::RandomStream& random, const Augmentation& augmentation,
                             int from_px, int to_px);

/// Four pictures around a point, each with a corner in it, on a square of twice their side.
/// What leaves the square is cut; a box that keeps less than `min_kept_share` of its area is
/// ignored.
/// @param x_px, y_px  The point, in [side / 2, 3 side / 2].
[[nodiscard]] Sample compose_mosaic(const std::array<const Sample*, 4>& samples, int x_px,
                                    int y_px, double min_kept_share);

/// Boxes after `warp`; those that vanish go, those that are cut too far are ignored.
[[nodiscard]] std::vector<LabeledBox> warp_boxes(const std::vector<LabeledBox>& boxes,
                                                 const Warp& warp, double min_kept_share);

/// Scales hue, saturation and value: by the factors, as 8-bit HSV.
void scale_hsv(core::Image<core::Rgb8>& image, double hue, double saturation, double value);

/// Bytes to planes of [0, 1] with gain, tint and saturation (1 leaves them as they are).
struct Colour {
  std::array<float, 3> gain{1.0F, 1.0F, 1.0F};
  float saturation = 1.0F;

  void write_planes(const core::Image<core::Rgb8>& image, float* pixels) const;
};

[[nodiscard]] Colour draw_colour(core::RandomStream& random);

}  // namespace segsim::perception
