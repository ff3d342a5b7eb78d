#pragma once

/// @file
/// The two parts of most sensors' errors: one that is new with every reading, and one that
/// wanders (a bias).

#include <cstdint>
#include <string>

#include "core/random.h"
#include "core/stages.h"

namespace segsim::sim {

/// In the unit of the reading.
struct ErrorModel {
  double sigma = 0.0;            ///< Of each reading, independent.
  double drift = 0.0;            ///< Of the bias, at any time.
  double drift_time_s = 3600.0;  ///< After so long the bias has forgotten 63 % of what it was.

  [[nodiscard]] bool none() const { return sigma == 0.0 && drift == 0.0; }
};

/// Error of one channel of one sensor: white noise plus a first-order Gauss-Markov process,
/// which is what hector_gazebo_plugins (Meyer, Kohlbrecher et al. 2012, "Comprehensive
/// simulation of quadrotor UAVs using ROS and Gazebo") gives Jackal's IMU and GPS. The exact
/// solution is stepped,
///
///     b(t + h) = e^(-h/T) b(t) + drift sqrt(1 - e^(-2h/T)) N(0, 1),  b(0) = drift N(0, 1),
///
/// so that its spread does not depend on the rate and needs no time to build up.
class SlowError {
 public:
  /// @param name  Of the channel; together with the seed and the number of the reading it
  /// names the random numbers.
  SlowError(const ErrorModel& model, std::uint64_t seed, std::string name);

  /// The error of the reading at that time. Times ascend.
  double next(core::TimeNs time_ns);

 private:
  ErrorModel model_;
  std::uint64_t seed_;
  std::string name_;
  std::uint64_t readings_ = 0;
  core::TimeNs last_ns_ = 0;
  double bias_ = 0.0;
};

}  // namespace segsim::sim
