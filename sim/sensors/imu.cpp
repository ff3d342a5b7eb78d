#include "sim/sensors/imu.h"

#include <cmath>

#include "core/check.h"

namespace segsim::sim {

Imu::Imu(const ImuModel& model, const core::Pose2& start, std::uint64_t seed)
    : accel_error_{SlowError(model.accel_mps2, seed, "imu/accel_x"),
                   SlowError(model.accel_mps2, seed, "imu/accel_y"),
                   SlowError(model.accel_mps2, seed, "imu/accel_z")},
      gyro_error_{SlowError(model.gyro_radps, seed, "imu/gyro_x"),
                  SlowError(model.gyro_radps, seed, "imu/gyro_y"),
                  SlowError(model.gyro_radps, seed, "imu/gyro_z")},
      pose_(start),
      read_pose_(start) {}

void Imu::move_to(core::TimeNs time_ns, const core::Pose2& pose) {
  if (time_ns <= now_ns_) return;
  const double h = core::seconds(time_ns - now_ns_);
  velocity_mps_ = glm::dvec2(pose.x_m - pose_.x_m, pose.y_m - pose_.y_m) / h;
  turned_rad_ += core::wrap_angle_rad(pose.yaw_rad - pose_.yaw_rad);
  pose_ = pose;
  now_ns_ = time_ns;
}

ImuReading Imu::read() {
  SEGSIM_CHECK(now_ns_ > read_ns_, "an IMU reading covers some time");
  const double h = core::seconds(now_ns_ - read_ns_);
  const glm::dvec2 change = (velocity_mps_ - read_velocity_mps_) / h;
  const double heading = read_pose_.yaw_rad + 0.5 * turned_rad_;
  const double c = std::cos(heading), s = std::sin(heading);
  ImuReading reading;
  reading.accel_mps2 = {c * change.x + s * change.y, c * change.y - s * change.x,
                        kGravity_mps2};
  reading.gyro_radps = {0.0, 0.0, turned_rad_ / h};
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = static_cast<std::size_t>(axis);
    reading.accel_mps2[axis] += accel_error_[k].next(now_ns_);
    reading.gyro_radps[axis] += gyro_error_[k].next(now_ns_);
  }
  read_velocity_mps_ = velocity_mps_;
  read_pose_ = pose_;
  read_ns_ = now_ns_;
  turned_rad_ = 0.0;
  return reading;
}

}  // namespace segsim::sim
