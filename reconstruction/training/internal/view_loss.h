#pragma once

/// @file
/// What a drawn view costs, and the recorded images that it is compared with.

#include "reconstruction/training/geometry_training.h"
#include "reconstruction/training/internal/raster_function.h"
#include "reconstruction/training/training_config.h"
#include "reconstruction/training/training_set.h"

namespace segsim::reconstruction::internal {

/// A view's images as tensors.
struct ViewTargets {
  Tensor rgb;      ///< [height, width, 3] in [0, 1].
  Tensor depth_m;  ///< [height, width], NaN = unknown; or undefined.
  /// [height, width], how much depth weighs, > 0; undefined if what measured it is not known.
  Tensor depth_weight;
  Tensor valid;  ///< [height, width] bool, or undefined.
};

[[nodiscard]] ViewTargets view_targets(const TrainingView& view, const at::Device& device);

/// Weighted sum of the losses of geometry_training.h; the distortion's if it was drawn.
/// @param exposure  [2, 3]: logarithm of the gain, and offset; or undefined.
/// @param rays  camera_rays(); undefined: without normal consistency and distances of planes.
/// @param step  The losses are written there.
[[nodiscard]] Tensor view_loss(const ViewTensors& drawn, const ViewTargets& targets,
                               const GeometryConfig::Loss& weight, const Tensor& exposure,
                               const Tensor& rays, const core::CameraPose& T_world_camera,
                               GeometryStep& step);

/// The derivatives of leaves after backward().
[[nodiscard]] SurfelTensors gradients_of(const SurfelTensors& leaves);

}  // namespace segsim::reconstruction::internal
