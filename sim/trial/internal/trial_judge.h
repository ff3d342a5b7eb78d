#pragma once

/// @file
/// What the world says about a trial: how far the goal is, whether it is in view, when time is
/// over, and what the end is worth. Nothing here reaches the policy.

#include <memory>
#include <optional>

#include "sim/trial/internal/robot_camera.h"

namespace segsim::sim::internal {

class TrialJudge {
 public:
  TrialJudge(const Episode& episode, const TrialOptions& options, const World& world);
  /// @param to_goal  Distances to the episode's view points; null: it has none.
  TrialJudge(const Episode& episode, const TrialOptions& options,
             std::shared_ptr<const DistanceField> to_goal);

  /// A STOP at exactly the time limit still counts.
  [[nodiscard]] bool in_time(core::TimeNs now_ns) const { return now_ns <= limit_ns_; }
  /// A goal instance is in the image, with enough pixels.
  [[nodiscard]] bool sees_goal(const GoalView& view) const {
    return view.largest_instance >= options_.visible_pixels;
  }
  /// Geodesic to the nearest view point; infinity if the episode has none, or off the
  /// navigable area.
  [[nodiscard]] double distance_m(const core::Pose2& pose) const;

  // How the trial ended. Of none of these, time is over.
  void collided() { outcome_ = Outcome::kCollision; }
  /// A rule of the budget ended it.
  void aborted() { outcome_ = Outcome::kAborted; }
  /// The policy's STOP took effect. @param view  What the camera sees at that moment.
  void stopped(core::StopReason reason, const core::Pose2& pose, const GoalView& view);

  /// Outcome and figures of merit.
  /// @param result  With its path.  @param last_view  Of the newest image; counts if the
  /// policy did not stop.
  void score(const core::Pose2& final_pose, const GoalView& last_view,
             TrialResult& result) const;

 private:
  const Episode& episode_;
  const TrialOptions& options_;
  core::TimeNs limit_ns_;
  std::shared_ptr<const DistanceField> to_goal_;
  Outcome outcome_ = Outcome::kTimeout;
  std::optional<core::StopReason> stop_reason_;
  GoalView stop_view_;
};

}  // namespace segsim::sim::internal
