#pragma once

/// @file
/// Policies to compare a search with: the way that only the simulator knows, chance, and a
/// fixed list of actions.

#include <functional>
#include <memory>
#include <vector>

#include "core/stages.h"
#include "nav/motion/discrete_motion.h"
#include "nav/motion/path_follower.h"

namespace segsim::nav {

/// Corners of the shortest way from a place to the goal (Odom); empty if there is none.
/// Whoever runs the trial provides it: nothing in this module knows the goal.
using PathOracle = std::function<std::vector<glm::dvec2>(const glm::dvec2& from_odom_m)>;

struct OraclePathOptions {
  /// Keeps to the way: nothing here knows of obstacles, so a corner that is cut may be one.
  FollowerOptions follower = {
      .max_forward_mps = 0.5, .lookahead_m = 0.25, .turn_in_place_above_rad = 0.35};
  double centered_share =
      0.25;  ///< It stops when a goal box lies this near to the image's middle.
  double replan_period_s = 1.0;
  /// It backs out if it came less than 2 cm on in so long while it drove.
  double stuck_s = 1.5;
  double back_s = 1.0, back_mps = 0.15;
};

/// Drives the oracle's way, then turns until the goal is detected in the middle of the image,
/// at most once around. Stop reasons: kGoalReached, kNoPath.
[[nodiscard]] std::unique_ptr<core::Policy> make_oracle_path_policy(
    PathOracle oracle, const OraclePathOptions& options = {});

struct RandomPolicyOptions {
  DiscreteMotionOptions actions;
  double forward_chance = 0.5;  ///< Else a turn, to either side alike.
  double stop_chance = 0.01;    ///< Per action.
};

/// Actions by chance, from the episode's seed. Stop reason: kRandomStop.
[[nodiscard]] std::unique_ptr<core::Policy> make_random_policy(
    const RandomPolicyOptions& options = {});

/// A list of actions, then STOP. Stop reason: kScriptEnd.
[[nodiscard]] std::unique_ptr<core::Policy> make_script_policy(
    std::vector<DiscreteAction> actions, const DiscreteMotionOptions& options = {});

}  // namespace segsim::nav
