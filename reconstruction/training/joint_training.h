#pragma once

/// @file
/// Labels and surfels trained together (the paper's "End-to-end Panoptic Reconstruction"). The
/// surfels have been trained before; their number stays, and in every iteration a view is
/// drawn once:
///
///     view -> draw -> weights W of some pixels -> head: losses, steps, dL/dW and dL/dposition
///          -> losses of shape and colour + joint.labels * dL -> Adam on the surfels in view
///
/// A head's blended labels depend on geometry through W, and its queries on where surfels are;
/// both derivatives are exact. On the CPU only.

#include <memory>

#include "reconstruction/labels/panoptic_training.h"
#include "reconstruction/training/geometry_training.h"
#include "reconstruction/training/training_set.h"

namespace segsim::reconstruction {

/// The views of a training set with the surfels of a trainer, which move.
class JointViews : public PanopticViews, public MovingSurfels {};

/// Views without depth of their own keep the depth that the surfels had at first, and so do
/// neighbouring views of label warping keep their weights.
/// @param trainer  Its iterations are done. Like `set`, it must outlive the result.
[[nodiscard]] std::unique_ptr<JointViews> make_joint_views(const TrainingSet& set,
                                                           GeometryTrainer& trainer,
                                                           const JointConfig& config,
                                                           const GeometryDevice& device);

}  // namespace segsim::reconstruction
