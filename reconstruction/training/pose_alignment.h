#pragma once

/// @file
/// Poses of views that were not trained on, as finished surfels see them: when training moved
/// the poses of its views, the others are compared at a place that nothing refined.

#include <functional>
#include <span>
#include <vector>

#include "core/camera.h"
#include "core/frames.h"
#include "reconstruction/training/geometry_training.h"
#include "reconstruction/training/training_config.h"
#include "reconstruction/training/training_set.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction {

/// Steps of a view, and their lengths where the configuration has none: up to 4 cm and 2
/// degrees of way, more than hand-held recordings are off by.
inline constexpr int kAlignmentSteps = 60;
inline constexpr double kAlignmentRate_m = 2e-3, kAlignmentRate_rad = 2e-3;

/// For every view the pose with the least loss among those on the way of Adam down the
/// loss of colour (geometry_training.h), surfels frozen; a view that is well where it is
/// stays.
[[nodiscard]] std::vector<core::CameraPose> align_views(
    const std::vector<TrainingView>& views, const core::CameraIntrinsics& intrinsics,
    const renderer::SurfelCloud& surfels, const GeometryConfig& config,
    const GeometryDevice& device,
    const std::function<void(std::int64_t done, std::int64_t total)>& progress = {});

/// How far poses are from others.
struct PoseChange {
  double mean_m = 0.0, largest_m = 0.0;
  double mean_rad = 0.0, largest_rad = 0.0;
};
/// @param from, to  Of one length, not empty.
[[nodiscard]] PoseChange pose_change(std::span<const core::CameraPose> from,
                                     std::span<const core::CameraPose> to);

}  // namespace segsim::reconstruction
