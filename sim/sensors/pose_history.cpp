#include "sim/sensors/pose_history.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"

namespace segsim::sim {

core::Pose2 pose_between(const core::Pose2& from, const core::Pose2& to, double share) {
  const double turn_rad = core::wrap_angle_rad(to.yaw_rad - from.yaw_rad);
  const double dx = to.x_m - from.x_m, dy = to.y_m - from.y_m;
  // Chords of one circle: their lengths go with the sine of half the turn, their directions
  // with half the turn.
  const double half = 0.5 * turn_rad;
  const double length =
      std::abs(half) < 1e-9 ? share : std::sin(share * half) / std::sin(half);
  const double c = length * std::cos((share - 1.0) * half);
  const double s = length * std::sin((share - 1.0) * half);
  return {from.x_m + c * dx - s * dy, from.y_m + s * dx + c * dy,
          core::wrap_angle_rad(from.yaw_rad + share * turn_rad)};
}

void PoseHistory::add(core::TimeNs time_ns, const core::Pose2& pose) {
  SEGSIM_CHECK(time_ns >= last_ns(), "times ascend");
  if (time_ns == last_ns()) {
    steps_.back().pose = pose;
  } else {
    steps_.push_back({time_ns, pose});
  }
}

core::Pose2 PoseHistory::at(core::TimeNs time_ns) const {
  SEGSIM_CHECK(time_ns >= first_ns() && time_ns <= last_ns(), "a time that is known");
  const auto after =
      std::lower_bound(steps_.begin(), steps_.end(), time_ns,
                       [](const Step& step, core::TimeNs t) { return step.time_ns < t; });
  if (after->time_ns == time_ns) return after->pose;
  const Step& before = *(after - 1);
  return pose_between(before.pose, after->pose,
                      static_cast<double>(time_ns - before.time_ns) /
                          static_cast<double>(after->time_ns - before.time_ns));
}

void PoseHistory::forget_before(core::TimeNs time_ns) {
  while (steps_.size() > 1 && steps_[1].time_ns <= time_ns) steps_.pop_front();
}

}  // namespace segsim::sim
