#pragma once

/// @file
/// Dynamic window approach (Fox, Burgard and Thrun 1997) for a differential drive: among the
/// velocities that the robot can reach within one decision, the one whose arc comes best along
/// the path without the footprint touching an obstacle.
///
///     window  v in [v0 - a_b T, v0 + a T] and [-v_back, v_max],  w likewise
///     admissible  the rectangle on the arc over `horizon_s` and then to a stop is free
///     score  progress along the path, less the distance to it, the heading error at the end
///            and nearness of obstacles
///
/// Nav2's critics (PathDist, PathAlign, GoalDist, ObstacleFootprint) are the same terms; the
/// original has target heading, clearance and velocity.

#include <optional>
#include <vector>

#include "core/frames.h"
#include "core/stages.h"
#include "nav/motion/path_progress.h"
#include "nav/planning/cost_map.h"
#include "nav/planning/grid_planner.h"

namespace segsim::nav {

inline constexpr double kMinTurn_radps = 0.15;  ///< Slower turns take for ever to end.

struct DwaOptions {
  double max_forward_mps = 0.8, max_backward_mps = 0.0;
  double max_turn_radps = 1.2;
  double max_accel_mps2 = 1.5, max_turn_accel_radps2 = 4.0;
  double period_s = 0.25;  ///< Between decisions: what the window is computed for.
  int forward_samples = 9, turn_samples = 21;
  double horizon_s = 2.0, step_s = 0.1;
  double half_length_m = 0.254, half_width_m = 0.215;  ///< Footprint of the Jackal.
  double margin_m = 0.03;                              ///< Kept around it.
  double goal_tolerance_m = 0.12;
  double lookahead_m = 0.7;  ///< Where the arc should lead to, along the path.
  // Weights of the score, per metre, per radian, and for touching distance.
  double progress_weight = 1.0, path_weight = 1.5, heading_weight = 0.3,
         clearance_weight = 0.2;
};

/// A velocity of the window.
struct DwaCandidate {
  core::VelocityCommand command;
  bool admissible = false;
  double score = 0.0;  ///< Of admissible ones.
};

/// Whether the rectangle at a pose covers no occupied cell, and the mast keeps its distance
/// from what only it can hit. Cells count as their centre with half a cell around it.
[[nodiscard]] bool footprint_free(const core::Pose2& pose, const CostMap& map,
                                  const DwaOptions& options);

/// All sampled velocities around `now`, judged; zero is always among them.
[[nodiscard]] std::vector<DwaCandidate> dwa_candidates(const core::Pose2& T_odom_robot,
                                                       const core::VelocityCommand& now,
                                                       const glm::dvec2& towards_odom_m,
                                                       const std::vector<glm::dvec2>& path_m,
                                                       const CostMap& map,
                                                       const DwaOptions& options);

class DwaFollower {
 public:
  /// @throws ContractViolation for options out of range.
  explicit DwaFollower(const DwaOptions& options = {});
  void set_path(const Path& path) {
    path_ = path;
    progress_.reset();
  }
  void clear();
  /// The best admissible velocity; a turn on the spot towards the path where none leads on.
  /// `blocked()` tells whether nothing but turning was left.
  [[nodiscard]] core::VelocityCommand follow(const core::Pose2& T_odom_robot,
                                             const CostMap& map);
  [[nodiscard]] bool blocked() const { return blocked_; }

 private:
  DwaOptions options_;
  Path path_;
  PathProgress progress_;
  core::VelocityCommand last_;
  bool blocked_ = false;
};

}  // namespace segsim::nav
