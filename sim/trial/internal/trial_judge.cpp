#include "sim/trial/internal/trial_judge.h"

#include <cmath>
#include <limits>
#include <utility>

#include "sim/trial/metrics.h"

namespace segsim::sim::internal {

namespace {

/// A scripted drive has no goal, and no use for the distances to it.
std::shared_ptr<const DistanceField> distances_of(const Episode& episode, const World& world) {
  if (episode.view_points_m.empty()) return nullptr;
  return std::make_shared<const DistanceField>(world.distance_to(episode.view_points_m));
}

}  // namespace

TrialJudge::TrialJudge(const Episode& episode, const TrialOptions& options, const World& world)
    : TrialJudge(episode, options, distances_of(episode, world)) {}

TrialJudge::TrialJudge(const Episode& episode, const TrialOptions& options,
                       std::shared_ptr<const DistanceField> to_goal)
    : episode_(episode),
      options_(options),
      limit_ns_(std::llround(options.time_limit_s * 1e9)),
      to_goal_(std::move(to_goal)) {}

double TrialJudge::distance_m(const core::Pose2& pose) const {
  if (!to_goal_) return std::numeric_limits<double>::infinity();
  return to_goal_->at({pose.x_m, pose.y_m}, DistanceField::kBaseSnap_m);
}

void TrialJudge::stopped(core::StopReason reason, const core::Pose2& pose,
                         const GoalView& view) {
  stop_reason_ = reason;
  stop_view_ = view;
  if (reason != core::StopReason::kGoalReached) {
    outcome_ = Outcome::kGaveUp;
  } else if (!(distance_m(pose) < options_.success_distance_m)) {
    outcome_ = Outcome::kStoppedFar;  // Near is strict: at exactly that distance it fails.
  } else {
    const bool enough = sees_goal(view) || !options_.require_visible;
    outcome_ = enough ? Outcome::kSuccess : Outcome::kNotVisible;
  }
}

void TrialJudge::score(const core::Pose2& final_pose, const GoalView& last_view,
                       TrialResult& result) const {
  result.outcome = outcome_;
  result.success = outcome_ == Outcome::kSuccess;
  result.stop_reason = stop_reason_;
  result.final_goal_pixels = (stop_reason_ ? stop_view_ : last_view).largest_instance;
  result.distance_to_goal_m = distance_m(final_pose);
  result.shortest_path_m = episode_.shortest_path_m;
  result.spl = spl(result.success, result.shortest_path_m, result.path_m);
  result.soft_spl = soft_spl(result.distance_to_goal_m, result.shortest_path_m, result.path_m);
}

}  // namespace segsim::sim::internal
