#pragma once

/// @file
/// A training set and finished surfels as panoptic training sees them.

#include <memory>
#include <vector>

#include "reconstruction/labels/panoptic_training.h"
#include "reconstruction/training/geometry_training.h"
#include "reconstruction/training/training_set.h"

namespace segsim::reconstruction {

/// Views of `set.training`, drawn with frozen surfels on the given device. A view without
/// depth of its own has that of the surfels.
/// @param set, surfels  Must outlive the result; the views must have masks.
/// @param poses  Of the views, if training moved them; empty: as recorded.
[[nodiscard]] std::unique_ptr<PanopticViews> make_training_views(
    const TrainingSet& set, const renderer::SurfelCloud& surfels, const GeometryDevice& device,
    std::vector<core::CameraPose> poses = {});

}  // namespace segsim::reconstruction
