#pragma once

/// @file
/// Boxes of the goal's instances, read off a frame's labels, for pictures.

#include <cstdint>
#include <vector>

#include "core/render.h"
#include "perception/data/labeled_box.h"

namespace segsim::experiments::drawing {

/// @param class_id  0: no goal class, no boxes.
[[nodiscard]] std::vector<perception::LabeledBox> goal_boxes(const core::Frame& frame,
                                                             std::uint16_t class_id);

}  // namespace segsim::experiments::drawing
