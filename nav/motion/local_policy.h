#pragma once

/// @file
/// From where the robot is to a place nearby, one discrete action at a time: the part that
/// VLFM's PointNav network plays. The default plans on the inflated grid and needs no weights.

#include <memory>

#include "nav/motion/discrete_motion.h"
#include "nav/planning/cost_map.h"

namespace segsim::nav {

class LocalPolicy {
 public:
  virtual ~LocalPolicy() = default;
  /// Forgets what was remembered of the way to the last goal.
  virtual void reset() = 0;
  /// kStop: it believes to be there, or that there is no way.
  [[nodiscard]] virtual DiscreteAction act(const core::Observation& observation,
                                           const core::Pose2& T_odom_robot,
                                           const glm::dvec2& goal_odom_m,
                                           const CostMap& map) = 0;
};

enum class GridPlanner : std::uint8_t { kAstar, kFastMarching };

struct GridLocalOptions {
  GridPlanner planner = GridPlanner::kAstar;
  double arrive_m = 0.20;     ///< This near to the goal it says kStop.
  double lookahead_m = 0.45;  ///< Along A*'s path; fast marching looks 0.25 m ahead (SemExp).
  DiscreteMotionOptions actions;
};

[[nodiscard]] std::unique_ptr<LocalPolicy> make_grid_local_policy(
    const GridLocalOptions& options = {});

}  // namespace segsim::nav
