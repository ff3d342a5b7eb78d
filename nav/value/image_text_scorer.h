#pragma once

/// @file
/// How much an image promises that the target is near: the part of VLFM that BLIP-2 plays
/// ("Seems like there is a <target> ahead.", one cosine). The implementations here need no
/// weights.

#include <memory>
#include <span>
#include <string>

#include "core/stages.h"

namespace segsim::nav {

class ImageTextScorer {
 public:
  virtual ~ImageTextScorer() = default;
  /// Promise of the image for a target, in [0, 1]: its class, or its text for those that read.
  /// @param detections  Of this image, all classes.
  [[nodiscard]] virtual double score(const core::Observation& observation,
                                     std::span<const core::Detection> detections,
                                     const core::ObjectGoal& target) = 0;
};

/// The same promise for every image: frontiers then differ by their distance only.
[[nodiscard]] std::unique_ptr<ImageTextScorer> make_constant_scorer(double value = 0.5);

/// Open space promises: mean depth of the image's middle half of rows over `range_m`, at most
/// 1; pixels without depth count as 0.
[[nodiscard]] std::unique_ptr<ImageTextScorer> make_open_space_scorer(double range_m = 5.0);

}  // namespace segsim::nav
