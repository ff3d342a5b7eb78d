#pragma once

/// @file
/// How far an image can be trusted that was rendered from a reconstruction: holes, and the
/// distance to the views that it was made from.

#include <span>
#include <vector>

#include "core/frames.h"
#include "core/image.h"

namespace segsim::sim {

struct RenderValidity {
  double mean_alpha = 0.0;
  double hole_share = 0.0;  ///< Of pixels with alpha < 0.5.
  // Of the nearest training view; infinity if none is known.
  double view_m = 0.0;          ///< Between the cameras.
  double view_rad = 0.0;        ///< Between their optical axes.
  bool render_invalid = false;  ///< hole_share exceeds the limit.
};

/// The nearest view is the one with the smallest sum of distance [m] and angle [rad]: one that
/// looks the other way from the same place saw nothing of what this one sees.
/// @param views  Of the recording (core/camera_path.h); may be empty.
[[nodiscard]] RenderValidity render_validity(const core::Image<float>& alpha,
                                             const core::CameraPose& T_world_camera,
                                             std::span<const core::CameraPose> views,
                                             double hole_limit);

/// Over the images of a trial.
struct RenderValiditySummary {
  int images = 0, invalid_images = 0;
  double mean_alpha = 0.0, hole_share = 0.0;   ///< Means.
  double view_m = 0.0, farthest_view_m = 0.0;  ///< Mean, largest; infinity if not known.
  double view_rad = 0.0;                       ///< Mean.
};
[[nodiscard]] RenderValiditySummary summary_of(std::span<const RenderValidity> images);

}  // namespace segsim::sim
