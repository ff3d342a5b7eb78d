#pragma once

/// @file
/// From groups of surfels to classes and objects, by the masks of all views (the last stage of
/// OpenGaussian, with classes of masks in place of phrases).

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "core/scene_bundle.h"

namespace segsim::reconstruction::internal {

/// Pixels of views; arrays of one size.
struct GroupedPixels {
  std::vector<std::int64_t> frame, group;
  std::vector<std::int64_t> class_index;  ///< In the table of classes.
  std::vector<std::int64_t> mask_id;      ///< Of a thing, in its frame; 0 = none.
  std::vector<float> feature;             ///< [pixels, feature_size], in [0, 1].
};

struct GroupNamingOptions {
  double min_score = 0.2;     ///< IoU times likeness of a group and a mask.
  double min_together = 0.5;  ///< Of the views that show two groups.
};

struct GroupName {
  std::int64_t class_index = -1;  ///< -1: no pixel shows the group.
  std::int64_t object = 0;        ///< From 1, the same for all its groups; 0 = not of a thing.
  bool operator==(const GroupName&) const = default;
};

/// The class of a group is the one that most of its masks have: in every view the mask (or
/// region of a stuff class) with the largest IoU times (1 - mean difference of the features),
/// if that is above min_score; the class of most of its pixels if no mask is. Two groups of
/// one thing class are one object if one mask holds most pixels of both in at least
/// min_together of the views that show both in masks.
/// @param group_feature  [groups, feature_size].
[[nodiscard]] std::vector<GroupName> name_groups(const GroupedPixels& pixels,
                                                 const std::vector<float>& group_feature,
                                                 std::size_t groups,
                                                 const std::vector<core::SceneClass>& classes,
                                                 const GroupNamingOptions& options);

}  // namespace segsim::reconstruction::internal
