#pragma once

/// @file
/// What a spec and a script say alike of how a trial is run.

#include <memory>
#include <utility>

#include "experiments/specs/sensor_spec.h"
#include "experiments/specs/spec.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::trials {

/// Options with clock, faults and success rule left as they are by default.
/// @param described  An ExperimentSpec or a ScriptedTrial: times, camera, contact, collision,
/// localisation.
/// @param sensors  What it says of sensors, bound to the scene; nullptr: an exact camera
/// alone.
template <class Description>
[[nodiscard]] sim::TrialOptions base_trial_options(
    const Description& described, double camera_height_m,
    std::shared_ptr<const sim::SensorSettings> sensors) {
  sim::TrialOptions options;
  options.control_period_s = described.control_period_s;
  options.time_limit_s = described.time_limit_s;
  options.camera = described.camera.intrinsics();
  options.camera_height_m = camera_height_m;
  options.camera_pitch_down_rad = described.camera.pitch_down_rad();
  options.depth_range_m = described.camera.depth_range_m;
  if (described.slide_on_contact) options.contact_response = sim::ContactResponse::kSlide;
  options.collision = described.collision;
  if (described.localisation.odometry) {
    options.odometry = sim::OdometryNoise::skid_steered_indoors();
  }
  options.localiser = described.localisation.localiser;
  options.sensors = std::move(sensors);
  return options;
}

}  // namespace segsim::experiments::trials
