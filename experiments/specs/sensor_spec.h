#pragma once

/// @file
/// The sensors and the localisation of a spec (docs/sensors.md has every key):
///
///     sensors:
///       camera: {exposure_ms: 20, sub_poses: 5, full_well: 5000, read_noise: 8, jpeg_quality:
///       90,
///                hole_limit: 0.2, depth: {noise: kinect-axial, flying_pixels: 0.3}}
///       lidar: {rate_hz: 10, sweep_ms: 15}
///       imu: {}
///       odometry: {}
///       gps: {rate_hz: 5, error_m: {sigma: 0.3, drift: 1.5, drift_time_s: 120}}
///       compass: {}
///     localisation: {type: noisy, position_m: {sigma: 0.03}, heading_deg: {sigma: 1}}
///
/// `{}` is a sensor with its defaults; one that is not named is not there.

#include <memory>
#include <optional>

#include "core/config.h"
#include "core/scene_bundle.h"
#include "sim/ground/world.h"
#include "sim/sensors/localiser.h"
#include "sim/sensors/sensor_suite.h"

namespace segsim::experiments::specs {

/// The key `sensors` of a spec; none if it is absent.
[[nodiscard]] std::optional<sim::SensorSettings> read_sensors(const core::ConfigNode& root);

struct LocalisationSpec {
  bool odometry = false;                         ///< Wheel odometry alone.
  std::optional<sim::LocaliserModel> localiser;  ///< With neither the robot knows its pose.
};
/// The key `localisation` of a spec: perfect (default), odom, noisy, or a map with the type
/// and the errors of `noisy`.
[[nodiscard]] LocalisationSpec read_localisation(const core::ConfigNode& root);

/// The settings with what they need of a scene: rays against its collision mesh, the views of
/// its recording (if the bundle kept them; one without a folder has none).
[[nodiscard]] std::shared_ptr<const sim::SensorSettings> bind_sensors(
    sim::SensorSettings settings, const core::SceneBundle& bundle, const sim::World& world);

}  // namespace segsim::experiments::specs
