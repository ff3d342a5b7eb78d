#pragma once

/// @file
/// Preconditions that every DifferentiableRasterizer has.

#include <cstdint>
#include <string>

#include "core/check.h"
#include "reconstruction/rasterizer/surfel_parameters.h"
#include "renderer/scene/projection_camera.h"

namespace segsim::reconstruction::internal {

template <class Real>
void check_parameters(const SurfelParameters<Real>& s) {
  SEGSIM_CHECK(s.count >= 0 && s.count < (std::int64_t{1} << 31U),
               std::to_string(s.count) + " surfels");
  SEGSIM_CHECK(
      0 <= s.active_sh_degree && s.active_sh_degree <= s.sh_degree && s.sh_degree <= 3,
      "SH degree " + std::to_string(s.active_sh_degree) + " of " +
          std::to_string(s.sh_degree));
  SEGSIM_CHECK(
      s.count == 0 || (s.position_m != nullptr && s.log_scale != nullptr &&
                       s.rotation != nullptr && s.opacity_logit != nullptr && s.sh != nullptr),
      "a surfel array is null");
}

/// Of forward().
template <class Real>
void check_view(const SurfelParameters<Real>& surfels, const core::CameraIntrinsics& camera,
                const TrainingImages<Real>& images) {
  renderer::internal::check_intrinsics(camera);
  check_parameters(surfels);
  SEGSIM_CHECK(images.width_px == camera.width_px && images.height_px == camera.height_px,
               "images of " + std::to_string(images.width_px) + " x " +
                   std::to_string(images.height_px) + " for a camera of " +
                   std::to_string(camera.width_px) + " x " + std::to_string(camera.height_px));
  SEGSIM_CHECK(images.rgb != nullptr && images.depth_m != nullptr && images.alpha != nullptr &&
                   images.normal != nullptr && images.median_m != nullptr,
               "an image is null");
}

/// Of backward().
/// @param surfel_count, width_px, height_px  Of the last forward(); width 0: there was none.
template <class Real>
void check_derivatives(const SurfelParameters<Real>& surfels,
                       const TrainingImages<const Real>& loss,
                       const SurfelGradients<Real>& gradients, std::int64_t surfel_count,
                       int width_px, int height_px) {
  SEGSIM_CHECK(width_px > 0, "no forward() yet");
  check_parameters(surfels);
  SEGSIM_CHECK(
      surfels.count == surfel_count,
      std::to_string(surfels.count) + " surfels, forward had " + std::to_string(surfel_count));
  SEGSIM_CHECK(loss.width_px == width_px && loss.height_px == height_px,
               "derivatives of another size than the images");
  SEGSIM_CHECK(
      surfels.count == 0 || (gradients.position_m != nullptr &&
                             gradients.log_scale != nullptr && gradients.rotation != nullptr &&
                             gradients.opacity_logit != nullptr && gradients.sh != nullptr),
      "a gradient array is null");
}

}  // namespace segsim::reconstruction::internal
