#pragma once

/// @file
/// Accelerometer and gyroscope of a base that drives on a level floor, in the robot's frame.
///
/// A reading is the mean over the time since the last one, as an inertial sensor that samples
/// fast and averages delivers it: the gyroscope the turn, the accelerometer the change of
/// velocity plus gravity (a robot at rest reads +9.80665 m/s^2 upwards). So a receiver that
/// adds up noiseless readings comes back to the driven path:
///
///     yaw_k = yaw_(k-1) + h gyro_z
///     v_k   = v_(k-1) + h R(mean of yaw_(k-1) and yaw_k) accel_xy
///
/// Defaults: Jackal's (jackal_description, jackal.gazebo): 50 Hz, noise and drift 0.005 m/s^2
/// and 0.005 rad/s in each axis. The time constant of the drift is that plugin's default.

#include <array>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "core/frames.h"
#include "core/stages.h"
#include "sim/sensors/slow_error.h"

namespace segsim::sim {

inline constexpr double kGravity_mps2 = 9.80665;  ///< Standard gravity.

struct ImuModel {
  ErrorModel accel_mps2{0.005, 0.005, 3600.0};
  ErrorModel gyro_radps{0.005, 0.005, 3600.0};
};

struct ImuReading {
  glm::dvec3 accel_mps2{0.0};  ///< Specific force.
  glm::dvec3 gyro_radps{0.0};
};

class Imu {
 public:
  Imu(const ImuModel& model, const core::Pose2& start, std::uint64_t seed);

  /// The base has come to that pose at that time. Times ascend.
  void move_to(core::TimeNs time_ns, const core::Pose2& pose);
  /// The reading at the time of the last move_to(). @pre time has passed since the last one.
  [[nodiscard]] ImuReading read();

 private:
  std::array<SlowError, 3> accel_error_, gyro_error_;
  core::Pose2 pose_, read_pose_;                           ///< Now; at the last reading.
  glm::dvec2 velocity_mps_{0.0}, read_velocity_mps_{0.0};  ///< World.
  core::TimeNs now_ns_ = 0, read_ns_ = 0;
  double turned_rad_ = 0.0;  ///< Since the last reading, not wrapped.
};

}  // namespace segsim::sim
