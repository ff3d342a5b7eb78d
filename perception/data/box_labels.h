#pragma once

/// @file
/// Ground-truth boxes from label images, so that nobody draws boxes by hand.
///
/// A box is tight around the *visible* pixels of one instance: boxes of hidden extent would
/// teach the detector to see through walls. Loose edges harm training more than missing boxes
/// do, so stray pixels (bleeding edges, floaters) are cut off by quantiles and by distance.
///
///     instance id -> class by majority -> pixels -> drop far components -> 0.5-99.5 % extents

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/scene_bundle.h"
#include "perception/data/labeled_box.h"

namespace segsim::perception {

struct BoxLabelOptions {
  double min_visible_share = 0.0006;   ///< Of the image's pixels: 40 px at 256 x 256.
  double min_visible_fraction = 0.15;  ///< Of the unoccluded object, where it is known.
  double min_valid_depth_share = 0.5;  ///< Of the instance's pixels, if depth is given.
  double occluded_below = 0.9;         ///< Visible fraction that makes a box `occluded`.
  double quantile = 0.005;             ///< Share of pixels cut off at each of the four sides.
  /// A component is dropped if the gap between its box and those kept exceeds this share of
  /// the longer side of the largest component's box (never less than 2 % of the image's
  /// width).
  double max_component_gap = 0.5;
};

/// What the labels of one view consist of. Images have equal sizes.
struct LabelView {
  const core::Image<std::uint16_t>* semantic = nullptr;  ///< Class ids, 0 = void.
  const core::Image<std::uint16_t>* instance = nullptr;  ///< Instance ids, 0 = none.
  const core::Image<float>* depth_m = nullptr;           ///< NaN = invalid; may be nullptr.
  /// The visible share of an instance's unoccluded pixels. Asked only for instances that get a
  /// label, since it may be costly. Those for which it returns nothing are not tested.
  std::function<std::optional<double>(std::uint16_t instance_id)> visible_fraction;
};

/// Labels every instance whose class (majority of its semantic pixels, void excluded) has a
/// name that is in `class_names`; other instances are left out.
/// @param scene_classes  Gives the names of semantic ids.
/// @param class_names  The detector's classes; LabeledBox::class_index points into it.
/// @returns  In ascending order of instance id. Instances below a threshold have `ignore` set.
[[nodiscard]] std::vector<LabeledBox> label_boxes(
    const LabelView& view, std::span<const core::SceneClass> scene_classes,
    std::span<const std::string> class_names, const BoxLabelOptions& options = {});

}  // namespace segsim::perception
