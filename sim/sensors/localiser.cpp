#include "sim/sensors/localiser.h"

#include "core/check.h"

namespace segsim::sim {

Localiser::Localiser(const LocaliserModel& model, std::uint64_t seed)
    : model_(model),
      x_m_(model.position_m, seed, "localisation/x"),
      y_m_(model.position_m, seed, "localisation/y"),
      yaw_rad_(model.heading_rad, seed, "localisation/yaw") {
  SEGSIM_CHECK(model.period_ns > 0, "period");
}

void Localiser::move_to(core::TimeNs time_ns, const core::Pose2& pose) {
  pose_ = pose;
  // Corrections lie on their own grid of times, whatever the steps of the caller.
  for (; next_ns_ <= time_ns; next_ns_ += model_.period_ns) {
    error_ = {x_m_.next(next_ns_), y_m_.next(next_ns_), yaw_rad_.next(next_ns_)};
  }
}

core::Pose2 Localiser::estimate() const {
  return {pose_.x_m + error_.x_m, pose_.y_m + error_.y_m,
          core::wrap_angle_rad(pose_.yaw_rad + error_.yaw_rad)};
}

}  // namespace segsim::sim
