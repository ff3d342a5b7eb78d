#pragma once

/// @file
/// VLFM, the two-stage object search of Yokoyama et al. 2024, as its code does it (A of the
/// design notes) or with its quirks repaired, each by itself:
///
///     spin -> explore (best frontier by the value map) <-> navigate (to the object) -> STOP
///                        \                                  /
///                          recover (back and turn; fixed Q6)
///
/// Every image updates obstacles, explored area, value map and object cloud. The learned parts
/// (image-text score, segmentation, local policy) are interfaces with defaults without
/// weights; detections come from whoever calls decide().
///
/// Departures, for either rule: maps take every image that comes, also those during an action;
/// poses and camera angles are used as given (the original assumes a level camera at a known
/// height); the place beside the object is chosen on the grid, where the original lets its
/// network drive at the object.

#include <array>
#include <memory>
#include <string>

#include "core/robot_base.h"
#include "core/stages.h"
#include "nav/behaviours/object_verification.h"
#include "nav/behaviours/recovery.h"
#include "nav/behaviours/sweep.h"
#include "nav/frontier/frontier_choice.h"
#include "nav/mapping/depth_inference.h"
#include "nav/mapping/obstacle_map.h"
#include "nav/motion/local_policy.h"
#include "nav/motion/path_follower.h"
#include "nav/objects/class_cloud.h"
#include "nav/objects/segmenter.h"
#include "nav/planning/approach.h"
#include "nav/planning/cost_map.h"
#include "nav/value/image_text_scorer.h"
#include "nav/value/value_map.h"

namespace segsim::nav {

enum class Motion : std::uint8_t {
  kDiscrete,  ///< 0.25 m and 30 degrees, by the local policy.
  kPursuit    ///< Pure pursuit of A*'s path.
};

struct VlfmOptions {
  VlfmRules rules;
  Motion motion = Motion::kPursuit;
  ObstacleMapOptions obstacles;
  ValueMapOptions values;
  FrontierChoiceOptions choice;
  double value_radius_m = 0.5;  ///< Of the disc whose median is a frontier's value.
  ClassCloudOptions cloud;
  /// Accepted scores: VLFM's 0.8 for its closed-set detector. The detectors here come with
  /// thresholds of their own, so the default accepts what they report.
  double min_score = 0.0;

  int spin_turns = 12;         ///< Of 30 degrees each.
  double stop_radius_m = 0.9;  ///< Planar, robot to object point.
  /// Before STOP face the object and wait for a detection there; without one its cloud is
  /// deleted. Not in VLFM.
  bool second_look = true;
  /// With discrete motion what a turn cannot correct counts as faced, too.
  VerificationOptions verification = {
      .facing_rad = 0.17, .look_s = 2.0, .from_first_facing = false, .longest_s = 7.0};

  /// Not in VLFM: drive to a place that nav/planning/approach.h chooses (at `distances` from
  /// the object's surface, open floor between) and look there, instead of stopping where the
  /// radius is crossed; an object that is not seen again gets one more look from farther away.
  /// The cloud is kept clean for it: no floor, nothing that a later view contradicts, and no
  /// way to a clump of a few points.
  bool approach = true;
  /// Fixed Q6 without `approach`: the limit counts where no nearer place is reachable.
  ApproachDistances distances = {.min_m = 0.5,
                                 .max_m = 0.75,
                                 .limit_m = 1.5,
                                 .arrival_m = 0.15,
                                 .width_m = 0.20,
                                 .sight_limit_m = 0.2};
  double approach_floor_m = 0.06, approach_carve_m = 3.0;  ///< ClassCloudOptions.
  double approach_support_share = 0.05;                    ///< Likewise.
  /// Not in VLFM: places that were seen only from afar are visited, with a turn around, when
  /// no frontier is left.
  SweepOptions sweep = {.most_places = 4};
  /// Not in VLFM: without anything new from near for so long the next narrow inflation is
  /// tried, and after the last one the search is given up (kNothingNew): a goal behind
  /// glass, a camera that shows no depth. Needs the sweep.
  double give_up_s = 45.0;
  /// Not in VLFM: with these inflations, one after the other, the search goes on when nothing
  /// else is left. The first is FrontierPolicyOptions::tight_radius_m, the last little more
  /// than the inscribed circle. Needs the sweep, too.
  std::array<double, 2> tight_radii_m{0.28, 0.235};

  CostMapOptions cost;
  DiscreteMotionOptions actions;
  FollowerOptions follower;
  double replan_period_s = 0.5;  ///< Pursuit.
  RecoveryOptions recovery = {.back_where_safe = false,
                              .felt_m = 0.10,
                              .felt_most_m = 0.25,
                              .random_stream = "vlfm_recovery"};  ///< Fixed Q6.

  // Null: the defaults of the headers. Shared by all episodes of the policy.
  std::shared_ptr<ImageTextScorer> scorer;  ///< Null: constant 0.5.
  std::shared_ptr<Segmenter> segmenter;
  std::shared_ptr<DepthInference> depth;  ///< Null: depth is measured.
  std::shared_ptr<LocalPolicy> local;
};

/// The numbers of the published configuration (camera at 0.88 m, agent radius 0.18 m), all
/// quirks as published, discrete actions, no second look.
[[nodiscard]] VlfmOptions published_vlfm();

/// For one robot with its camera on a mast: obstacles from the robot's clearance up to the
/// camera where the rule knows one band (published Q4), else the body and the mast.
[[nodiscard]] VlfmOptions vlfm_for(const core::RobotBase& robot, const VlfmRules& rules,
                                   double camera_height_m);

/// Stop reasons: kGoalReached, kNoFrontierLeft, kNothingNew, kPointnavStop (Q5), kMapExhausted
/// (Q9), kStuck (Q6).
/// @throws ContractViolation for options out of range.
[[nodiscard]] std::unique_ptr<core::Policy> make_vlfm_policy(const VlfmOptions& options);

/// Which kind of detector VLFM asks for a target.
struct DetectorRoute {
  bool closed_set = false, open_set = false;  ///< First the closed set, then the open one.
};

/// As published (Q14): any alias among the closed set's names goes to that detector; the open
/// one is a fallback only if another alias is missing there. Fixed: `open_set_targets` decide.
/// @param target  Aliases are separated by "|".
[[nodiscard]] DetectorRoute route_target(const std::string& target,
                                         const std::vector<std::string>& closed_set_names,
                                         const std::vector<std::string>& open_set_targets,
                                         const VlfmRules& rules);

}  // namespace segsim::nav
