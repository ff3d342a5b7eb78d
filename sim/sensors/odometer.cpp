#include "sim/sensors/odometer.h"

#include <cmath>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim {
namespace {

/// Motion in the frame of the base where it began.
struct Motion {
  double forward_m = 0.0, sideways_m = 0.0, turn_rad = 0.0;
};

Motion between(const core::Pose2& from, const core::Pose2& to) {
  const double dx = to.x_m - from.x_m, dy = to.y_m - from.y_m;
  const double turn_rad = core::wrap_angle_rad(to.yaw_rad - from.yaw_rad);
  // Along the chord of an arc.
  const double heading_rad = from.yaw_rad + 0.5 * turn_rad;
  const double c = std::cos(heading_rad), s = std::sin(heading_rad);
  return {c * dx + s * dy, c * dy - s * dx, turn_rad};
}

core::Pose2 moved(const core::Pose2& from, const Motion& motion) {
  const double heading_rad = from.yaw_rad + 0.5 * motion.turn_rad;
  const double c = std::cos(heading_rad), s = std::sin(heading_rad);
  return {from.x_m + c * motion.forward_m - s * motion.sideways_m,
          from.y_m + s * motion.forward_m + c * motion.sideways_m,
          core::wrap_angle_rad(from.yaw_rad + motion.turn_rad)};
}

}  // namespace

OdometryNoise OdometryNoise::skid_steered_indoors() {
  OdometryNoise noise;
  noise.trans_per_m = 0.02 * 0.02;
  noise.trans_per_rad = 0.005 * 0.005;
  noise.rot_per_rad = 0.03 * 0.03;
  noise.rot_per_m = 0.01 * 0.01;
  return noise;
}

Odometer::Odometer(const OdometryNoise& noise, const core::Pose2& start,
                   std::uint64_t episode_seed)
    : noise_(noise),
      seed_(episode_seed),
      anchor_true_(start),
      anchor_estimate_(start),
      now_(start) {
  SEGSIM_CHECK(noise.forward_slip < 1.0 && noise.turn_slip < 1.0, "slip");
}

void Odometer::move_to(core::TimeNs time_ns, const core::Pose2& pose) {
  now_ = pose;
  if (time_ns < next_update_ns_) return;
  next_update_ns_ = (time_ns / kPeriod_ns + 1) * kPeriod_ns;
  const std::uint64_t update = updates_++;
  Motion motion = between(anchor_true_, pose);
  anchor_true_ = pose;
  const double way_m = std::abs(motion.forward_m), turn_rad = std::abs(motion.turn_rad);
  if (way_m > 0.0 || turn_rad > 0.0) {
    core::RandomStream random(seed_, "odometry", update);
    motion.forward_m /= 1.0 - noise_.forward_slip;
    motion.turn_rad /= 1.0 - noise_.turn_slip;
    motion.forward_m += random.normal() * std::sqrt(noise_.trans_per_m * way_m +
                                                    noise_.trans_per_rad * turn_rad);
    motion.turn_rad +=
        random.normal() * std::sqrt(noise_.rot_per_rad * turn_rad + noise_.rot_per_m * way_m);
  }
  anchor_estimate_ = moved(anchor_estimate_, motion);
}

core::Pose2 Odometer::estimate() const {
  return moved(anchor_estimate_, between(anchor_true_, now_));
}

}  // namespace segsim::sim
