#pragma once

#include <vector>

#include "core/stages.h"

namespace segsim::perception {

/// Greedy non-maximum suppression within each class: in descending order of score (ties: the
/// lower input index first) a box is kept unless its IoU with a kept box of its class exceeds
/// `max_iou`.
/// @returns  At most `max_count` detections in that order. O(n log n + n * max_count).
[[nodiscard]] std::vector<core::Detection> suppress_overlaps(
    const std::vector<core::Detection>& detections, float max_iou, int max_count);

}  // namespace segsim::perception
