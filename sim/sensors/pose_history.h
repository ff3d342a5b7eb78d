#pragma once

/// @file
/// Where the robot was between two steps of the simulation.

#include <deque>

#include "core/frames.h"
#include "core/stages.h"

namespace segsim::sim {

/// The pose after a share of the way from one pose to the other with a constant twist: an arc
/// of a circle, or a straight line. @param share  In [0, 1].
[[nodiscard]] core::Pose2 pose_between(const core::Pose2& from, const core::Pose2& to,
                                       double share);

class PoseHistory {
 public:
  PoseHistory(core::TimeNs time_ns, const core::Pose2& pose) : steps_{{time_ns, pose}} {}

  /// Times ascend.
  void add(core::TimeNs time_ns, const core::Pose2& pose);
  /// @pre first_ns() <= time_ns <= last_ns()
  [[nodiscard]] core::Pose2 at(core::TimeNs time_ns) const;
  /// What is only needed for earlier times goes.
  void forget_before(core::TimeNs time_ns);

  [[nodiscard]] core::TimeNs first_ns() const { return steps_.front().time_ns; }
  [[nodiscard]] core::TimeNs last_ns() const { return steps_.back().time_ns; }
  [[nodiscard]] const core::Pose2& last() const { return steps_.back().pose; }

 private:
  struct Step {
    core::TimeNs time_ns = 0;
    core::Pose2 pose;
  };
  std::deque<Step> steps_;
};

}  // namespace segsim::sim
