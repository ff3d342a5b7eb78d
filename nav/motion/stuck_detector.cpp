#include "nav/motion/stuck_detector.h"

#include <algorithm>
#include <cmath>

namespace segsim::nav {
namespace {

constexpr double kMinForward_mps = 0.02, kMinTurn_radps = 0.05;  // Less is no motion.

}  // namespace

void StuckDetector::add(const core::Pose2& pose, const core::VelocityCommand& command) {
  if (std::abs(command.forward_mps) < kMinForward_mps &&
      std::abs(command.turn_radps) < kMinTurn_radps) {
    window_.clear();
    return;
  }
  window_.push_back(pose);
  if (static_cast<int>(window_.size()) > options_.decisions) window_.pop_front();
}

bool StuckDetector::stuck() const {
  if (static_cast<int>(window_.size()) < options_.decisions) return false;
  const core::Pose2& first = window_.front();
  return std::all_of(window_.begin(), window_.end(), [&](const core::Pose2& pose) {
    return std::hypot(pose.x_m - first.x_m, pose.y_m - first.y_m) < options_.distance_m &&
           std::abs(core::wrap_angle_rad(pose.yaw_rad - first.yaw_rad)) < options_.turn_rad;
  });
}

}  // namespace segsim::nav
