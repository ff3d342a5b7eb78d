#pragma once

/// @file
/// Boxes of the goal's instances, read off a frame's labels, for pictures.

#include <vector>

#include "core/render.h"
#include "perception/data/labeled_box.h"
#include "sim/trial/goal_objects.h"

namespace segsim::experiments::drawing {

[[nodiscard]] std::vector<perception::LabeledBox> goal_boxes(const core::Frame& frame,
                                                             const sim::GoalObjects& goal);

}  // namespace segsim::experiments::drawing
