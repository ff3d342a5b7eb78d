#pragma once

/// @file
/// A training set and finished surfels as panoptic training sees them.

#include <memory>

#include "renderer/training/geometry_training.h"
#include "renderer/training/panoptic_training.h"
#include "renderer/training/training_set.h"

namespace segsim::renderer {

/// Views of `set.training`, drawn with frozen surfels on the given device.
/// @param set, surfels  Must outlive the result; the views must have masks.
[[nodiscard]] std::unique_ptr<PanopticViews> make_training_views(const TrainingSet& set,
                                                                 const SurfelCloud& surfels,
                                                                 const GeometryDevice& device);

}  // namespace segsim::renderer
