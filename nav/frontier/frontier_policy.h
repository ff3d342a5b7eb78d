#pragma once

/// @file
/// Object search by frontiers: spin, explore the nearest frontier, drive to the object, look
/// again, stop. One rule for every detector; the structure is VLFM's (Yokoyama et al. 2024)
/// without the learned parts, with the "fixed" behaviours of its quirks.
///
///     initialize -> explore <-> navigate -> verify -> stop
///                      \          /
///                       recover
///
/// Time comes from Observation::capture_time_ns, randomness from the seed: equal observations
/// give equal decisions.

#include <memory>

#include "core/robot_base.h"
#include "core/stages.h"
#include "nav/behaviours/object_verification.h"
#include "nav/behaviours/recovery.h"
#include "nav/behaviours/spin.h"
#include "nav/behaviours/sweep.h"
#include "nav/frontier/frontiers.h"
#include "nav/mapping/occupancy_map.h"
#include "nav/motion/path_follower.h"
#include "nav/objects/object_map.h"
#include "nav/planning/approach.h"
#include "nav/planning/cost_map.h"

namespace segsim::nav {

struct FrontierPolicyOptions {
  OccupancyOptions occupancy;
  CostMapOptions cost;
  FrontierOptions frontiers;
  FrontierSelectorOptions selector;
  FollowerOptions follower;
  ObjectMapOptions objects;

  SpinOptions spin;  ///< First look around; VLFM: twelve turns of 30 degrees.
  RecoveryOptions recovery = {.blocked_decisions = 15};
  SweepOptions sweep;  ///< The second look around when no frontier is left.
  VerificationOptions verification;

  double replan_period_s = 0.5;    ///< Frontiers and paths are computed this often.
  double target_timeout_s = 45.0;  ///< A target not reached by then is given up.
  double no_progress_s = 12.0;     ///< ... or without 0.3 m less to go for this long.
  double tight_radius_m = 0.28;    ///< Inflation when nothing is left with the full one:
                                   ///< between the inscribed and the circumscribed circle.
  double bold_depth_m = 0.25;      ///< Then the robot enters the unknown: places this far in.
  // Approach and stop.
  double stop_distance_m = 0.8;  ///< Robot to nearest object point; VLFM: 0.9 m.
  ApproachDistances distances;
  double detour_m = 15.0;  ///< Weighted way through the unknown that a place on the object's
                           ///< side of a counter or a wall is worth.
  double recent_detection_s = 1.5;     ///< "Re-detected recently" for the stop rule.
  double second_look_sightings = 5.0;  ///< Weighted views that entitle an object to a second
                                       ///< look from farther away.
  double postpone_s = 15.0;  ///< An object that is not reachable yet waits this long.
  /// Replaces the default "nearest with size bonus" if set; for a value map.
  FrontierScorer scorer;
};

/// `wanted`, with everything that the robot decides; the defaults are those of the Jackal.
[[nodiscard]] FrontierPolicyOptions frontier_for(const core::RobotBase& robot,
                                                 FrontierPolicyOptions wanted = {});

/// Stop reasons: kGoalReached, kNoFrontierLeft, kStuck, kMapExhausted.
/// @throws ContractViolation for options out of range.
[[nodiscard]] std::unique_ptr<core::Policy> make_frontier_policy(
    const FrontierPolicyOptions& options = {});

}  // namespace segsim::nav
