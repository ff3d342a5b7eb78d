#pragma once

#include <optional>

#include "core/stages.h"

namespace segsim::perception {

/// One object of an image as the ground truth has it.
struct LabeledBox {
  int class_index = 0;  ///< Into the data set's class names.
  core::BoxPx box;      ///< Tight around the visible pixels, half-open.
  double area_px2 = 0;  ///< Visible pixels; equals the box's area if the source has no masks.
  std::optional<double>
      visible_fraction;  ///< Of the object's pixels if nothing hid it, [0, 1].
  bool ignore =
      false;           ///< Present but too hidden or too small: neither object nor background.
  bool crowd = false;  ///< COCO's iscrowd: a region of many objects; any share of it matches.

  bool truncated = false;  ///< Touches the image's border: a part lies outside, or may.
  bool occluded = false;  ///< Another surface hides a part (BoxLabelOptions decides how much).
  std::optional<double> distance_m;  ///< Camera to the object: median depth of its pixels.
  std::optional<int> instance_id;    ///< Of the scene it comes from: the same in all views.

  /// Whether it counts neither as found nor as missed.
  [[nodiscard]] bool not_scored() const { return ignore || crowd; }
};

}  // namespace segsim::perception
