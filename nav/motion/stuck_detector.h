#pragma once

/// @file
/// Notices that the robot does not move although it is told to.

#include <deque>

#include "core/frames.h"
#include "core/stages.h"

namespace segsim::nav {

struct StuckOptions {
  int decisions = 20;        ///< Window.
  double distance_m = 0.10;  ///< Less motion than this, and
  double turn_rad = 0.1745;  ///< less turning than this (10 degrees), in the whole window.
};

class StuckDetector {
 public:
  explicit StuckDetector(const StuckOptions& options = {}) : options_(options) {}
  void reset() { window_.clear(); }
  /// Adds the pose at which a decision was made and the command given there. A command that
  /// asks for no motion empties the window.
  void add(const core::Pose2& T_odom_robot, const core::VelocityCommand& command);
  /// Whether the window is full and no pose in it lies away from the first one.
  [[nodiscard]] bool stuck() const;

 private:
  StuckOptions options_;
  std::deque<core::Pose2> window_;
};

}  // namespace segsim::nav
