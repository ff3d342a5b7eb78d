#pragma once

/// @file
/// Localisation of limited accuracy: what a robot believes that compares its sensors with a
/// map. Unlike odometry (sim/sensors/odometer.h) its error does not grow with the way.

#include <cstdint>

#include "core/frames.h"
#include "core/stages.h"
#include "sim/sensors/slow_error.h"

namespace segsim::sim {

/// Defaults: 3 cm and 1 degree from estimate to estimate, 5 cm and 1 degree wandering over a
/// minute. An assumption for a particle filter on a 5 cm map indoors, not a measurement.
struct LocaliserModel {
  ErrorModel position_m{0.03, 0.05, 60.0};  ///< Along x and y of the world, each.
  ErrorModel heading_rad{0.0174533, 0.0174533, 60.0};
  core::TimeNs period_ns = 100'000'000;  ///< Of its corrections; between them the error stays.
};

class Localiser {
 public:
  Localiser(const LocaliserModel& model, std::uint64_t seed);

  /// The base stands at `pose` at that time (true). Times ascend.
  void move_to(core::TimeNs time_ns, const core::Pose2& pose);
  /// What the robot believes, in Odom, which is the world with this error.
  [[nodiscard]] core::Pose2 estimate() const;

 private:
  LocaliserModel model_;
  SlowError x_m_, y_m_, yaw_rad_;
  core::Pose2 pose_, error_;
  core::TimeNs next_ns_ = 0;
};

}  // namespace segsim::sim
