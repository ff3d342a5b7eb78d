#pragma once

/// @file
/// From exact depth to what a depth camera delivers. In this order:
///
///  1. `redwood` alone: each pixel is read at a place shaken by 0.25 px (one sigma), on a grid
///  of
///     every second pixel.
///  2. Flying pixels: at a jump of depth a pixel sees both surfaces and answers something
///     between.
///  3. Noise along the ray:
///     `kinect-axial`  sigma(z) = 0.0012 + 0.0019 (z - 0.4)^2 [m]; Nguyen, Izadi, Lovell
///     (2012),
///                     "Modeling Kinect sensor noise for improved 3D reconstruction and
///                     tracking", for surfaces seen at less than 60 degrees.
///     `redwood`       disparity 35.130 / z + N(0, 0.027778), rounded to 1/8; nothing beyond
///     10 m.
///                     Constants of the Redwood project's depth simulator (Choi, Zhou, Koltun
///                     2015, "Robust reconstruction of indoor scenes"), as habitat-sim uses
///                     them. Without their table of lens distortion.
///  4. Drop-out of surfaces seen at a grazing angle.
///  5. The range: what lies outside is not measured (NaN).

#include <cstdint>

#include "core/camera.h"
#include "core/image.h"
#include "sim/sensors/pixel_noise.h"

namespace segsim::sim {

enum class DepthNoise : std::uint8_t { kIdeal, kKinectAxial, kRedwood };
[[nodiscard]] const char* to_string(DepthNoise noise);

struct DepthModel {
  DepthNoise noise = DepthNoise::kIdeal;
  double min_range_m = 0.0;  ///< Nearer is not measured.
  double max_range_m = 6.0;  ///< Farther is not measured.
  /// Probability that a pixel at a jump (more than kJump of the nearer depth to a neighbour
  /// above, below, left or right) answers a depth between the two, at random.
  double flying_pixels = 0.0;
  /// Angle between the ray and the surface's normal from which on nothing comes back; 0:
  /// never.
  double grazing_limit_rad = 0.0;

  static constexpr float kJump = 0.05F;
};

/// Standard deviation of `kinect-axial` [m].
[[nodiscard]] inline float kinect_axial_sigma_m(float z_m) {
  return 0.0012F + 0.0019F * (z_m - 0.4F) * (z_m - 0.4F);
}

/// @param true_depth_m  Along +z; NaN or <= 0 where there is nothing.
/// @param measured_m  Resized; NaN where there is no measurement. Another image than the
/// first.
void measure_depth(const DepthModel& model, const core::CameraIntrinsics& camera,
                   const PixelNoise& noise, const core::Image<float>& true_depth_m,
                   core::Image<float>& measured_m);

}  // namespace segsim::sim
