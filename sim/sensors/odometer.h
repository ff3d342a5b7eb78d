#pragma once

/// @file
/// Wheel odometry: what the robot believes about its way.
///
/// Every 20 ms (50 Hz, the rate of Jackal's controller) the motion since the last update is
/// shaken and added to the estimate: its length by a normal error of variance
/// a_trans_m |d| + a_trans_rad |r|, its turn by one of variance a_rot_rad |r| + a_rot_m |d|
/// (d: metres driven, r: radians turned). This is the four-parameter model of Thrun, Burgard
/// and Fox, "Probabilistic Robotics" (2005), 5.4, with variances that grow with the way
/// instead of its square: so the drift of a way does not depend on the update rate. Slip is a
/// bias on top: wheels turn farther than the base moves.

#include <cstdint>

#include "core/frames.h"
#include "core/stages.h"

namespace segsim::sim {

struct OdometryNoise {
  double trans_per_m = 0.0;    ///< Variance of the length [m^2 / m].
  double trans_per_rad = 0.0;  ///< [m^2 / rad]
  double rot_per_rad = 0.0;    ///< Variance of the turn [rad^2 / rad].
  double rot_per_m = 0.0;      ///< [rad^2 / m]
  double forward_slip = 0.0;   ///< The base moves (1 - slip) of what the wheels say; [0, 1).
  double turn_slip = 0.0;      ///< Likewise for turns.

  /// 2 % and 0.6 degrees (one sigma) over a metre, 1.7 degrees over a radian. An assumption
  /// for a skid-steered base on a smooth floor, not a measurement.
  [[nodiscard]] static OdometryNoise skid_steered_indoors();
};

class Odometer {
 public:
  static constexpr core::TimeNs kPeriod_ns = 20'000'000;

  /// Starts with the true pose: Odom and World coincide there.
  Odometer(const OdometryNoise& noise, const core::Pose2& start, std::uint64_t episode_seed);

  /// The base stands at `pose` at that time (true). Times ascend.
  void move_to(core::TimeNs time_ns, const core::Pose2& pose);
  /// What the robot believes, in Odom.
  [[nodiscard]] core::Pose2 estimate() const;

 private:
  OdometryNoise noise_;
  std::uint64_t seed_;
  core::Pose2 anchor_true_, anchor_estimate_, now_;
  core::TimeNs next_update_ns_ = kPeriod_ns;
  std::uint64_t updates_ = 0;
};

}  // namespace segsim::sim
