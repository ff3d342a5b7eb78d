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

#include "core/stages.h"
#include "nav/frontier/frontiers.h"
#include "nav/mapping/occupancy_map.h"
#include "nav/motion/path_follower.h"
#include "nav/motion/stuck_detector.h"
#include "nav/objects/object_map.h"
#include "nav/planning/cost_map.h"

namespace segsim::nav {

struct FrontierPolicyOptions {
  OccupancyOptions occupancy;
  CostMapOptions cost;
  FrontierOptions frontiers;
  FrontierSelectorOptions selector;
  FollowerOptions follower;
  ObjectMapOptions objects;

  double spin_rate_radps = 1.2;    ///< First look around; VLFM: twelve turns of 30 degrees.
  double spin_angle_rad = 6.2832;  ///< 0 skips it.
  double replan_period_s = 0.5;    ///< Frontiers and paths are computed this often.
  double target_timeout_s = 45.0;  ///< A target not reached by then is given up.
  double no_progress_s = 12.0;     ///< ... or without 0.3 m less to go for this long.
  double tight_radius_m = 0.28;    ///< Inflation when nothing is left with the full one:
                                   ///< between inscribed 0.215 m and circumscribed 0.33 m.
  int sweep_places = 3;        ///< Places of the second look around when no frontier is left.
  double bold_depth_m = 0.25;  ///< Then the robot enters the unknown: places this far in.
  // Approach and stop.
  double stop_distance_m = 0.8;        ///< Robot to nearest object point; VLFM: 0.9 m.
  double stop_distance_limit_m = 1.5;  ///< Allowed where nothing nearer is reachable, or where
                                       ///< the object would drop below the image if nearer.
  double approach_min_m = 0.6;         ///< Places to drive to: this far from the surface ...
  double approach_max_m = 0.9;         ///< ... to this, or a little beyond view distance.
  double facing_tolerance_rad = 0.35;  ///< 20 degrees.
  double detour_m = 15.0;  ///< Weighted way through the unknown that a place on the object's
                           ///< side of a counter or a wall is worth.
  double recent_detection_s = 1.5;  ///< "Re-detected recently" for the stop rule.
  double verify_time_s = 2.0;       ///< Looking at the place without detection until refuted.
  double second_look_m = 1.1;       ///< An object that was seen often gets a second look from
                                    ///< this far or more: very near it may fill the image.
  double second_look_sightings = 5.0;  ///< Weighted views that entitle to it.
  double postpone_s = 15.0;  ///< An object that is not reachable yet waits this long.
  StuckOptions stuck;
  double recover_back_m = 0.15;
  double recover_turn_min_rad = 0.52,
         recover_turn_max_rad = 1.57;  ///< 30 .. 90 degrees, seeded.
  int recoveries_before_block =
      1;                    ///< Recoveries at one place before cells ahead are blocked.
  int max_recoveries = 12;  ///< In an episode; then it stops with kStuck.
  /// Replaces the default "nearest with size bonus" if set; for a value map.
  FrontierScorer scorer;
};

/// Stop reasons: kGoalReached, kNoFrontierLeft, kStuck, kMapExhausted.
/// @throws ContractViolation for options out of range.
[[nodiscard]] std::unique_ptr<core::Policy> make_frontier_policy(
    const FrontierPolicyOptions& options = {});

}  // namespace segsim::nav
