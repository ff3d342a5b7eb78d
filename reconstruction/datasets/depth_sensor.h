#pragma once

/// @file
/// How much a depth camera errs, by its kind: standard deviation along +z of a surface that is
/// seen from in front, z in metres.
///
///     kinect-v1   0.0012 + 0.0019 (z - 0.4)^2      structured light; Nguyen, Izadi, Lovell
///     2012 tof         0.0015 - 0.0005 z + 0.0003 z^2   Kinect v2; Fankhauser et al. 2015,
///     indoors stereo      0.0038 z^2                       z^2 s / (f b) with s = 0.08 px, f
///     = 424 px and
///                                                  b = 5 cm: RealSense D435 at 848 x 480
///     hololens    0.005 + 0.004 z                  ours; long-throw time of flight
///     generic     0.01 z
///
/// A time-of-flight camera (tof, hololens) mixes two surfaces in one pixel: such flying pixels
/// lie between both.

#include <cstdint>
#include <string>

#include "core/camera.h"
#include "core/image.h"

namespace segsim::reconstruction {

enum class DepthSensor : std::uint8_t {
  kUnstated,  ///< Nothing is assumed beyond what lifting and training do by themselves.
  kGeneric,
  kKinectV1,
  kTof,
  kStereo,
  kHololens
};

/// "none" (kUnstated), "generic", "kinect-v1", "tof", "stereo", "hololens".
/// @throws InputError for another word.
[[nodiscard]] DepthSensor parse_depth_sensor(const std::string& word,
                                             const std::string& place);
[[nodiscard]] std::string words_of(DepthSensor sensor);

/// Standard deviation at a depth [m]; nearer than 0.3 m as at 0.3 m.
/// @param sensor  Not kUnstated.
[[nodiscard]] float depth_sigma_m(DepthSensor sensor, float depth_m);

/// How a measurement weighs against one of the same sensor at 1 m: sigma(1 m) / sigma(depth),
/// the inverse of the error. Its square is the inverse variance.
[[nodiscard]] float depth_weight(DepthSensor sensor, float depth_m);

[[nodiscard]] bool has_flying_pixels(DepthSensor sensor);

/// Erases pixels between a nearer one on one side and a farther one on the other, if both
/// steps are larger than noise and than a surface that is seen at 80 degrees makes.
/// @param camera  Of the depth image.
/// @return How many.
std::size_t remove_flying_pixels(DepthSensor sensor, const core::CameraIntrinsics& camera,
                                 core::Image<float>& depth_m);

}  // namespace segsim::reconstruction
