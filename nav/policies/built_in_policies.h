#pragma once

/// @file
/// The policies that come with the program, each with the settings that a spec may give it:
///
///     policy: {type: vlfm, parity: fixed, quirks: {Q4: vlfm}, motion: discrete}
///     policy: {type: vlfm, scorer: {model: blip2.yaml}, segmenter: sam.yaml}
///     policy: {type: frontier, follower: dwa}
///     policy: {type: script, actions: [left*12, forward*4, stop]}
///     policy: {type: process, command: [python3, "${spec}/my_policy.py"]}
///     policy: {type: ros2, domain: 7, cmd_vel: twist_stamped}
///
/// docs/navigation.md lists all keys.

#include <filesystem>
#include <string>
#include <vector>

#include "nav/mapping/vlfm_rules.h"
#include "nav/motion/discrete_motion.h"
#include "nav/motion/local_policy.h"
#include "nav/objects/object_map.h"
#include "nav/policies/policy_registry.h"
#include "nav/value/semantic_prior.h"
#include "nav/value/value_map.h"
#include "nav/vlfm/vlfm_policy.h"

namespace segsim::nav {

/// "frontier", also called "frontier-nearest".
struct FrontierSettings {
  bool dynamic_window = false;  ///< `follower: dwa`
  double rival_iou = ObjectMapOptions{}.rival_iou;
};

/// How a view is rated that a value map is made of.
struct ScorerSettings {
  std::string type = "semantic-prior";  ///< Or "constant", "open-space", "model".
  std::filesystem::path prior;  ///< Empty: the built-in nav/policies/data/semantic_prior.yaml.
  std::filesystem::path model;  ///< Image-text model (docs/models.md).
  std::string prompt = "Seems like there is a {} ahead.";  ///< Of the model; as published.
};

/// "frontier-value"
struct FrontierValueSettings {
  FrontierSettings search;
  ScorerSettings scorer;
};

/// "vlfm"
struct VlfmSettings {
  VlfmRules rules;                            ///< `parity`, then `quirks`.
  Motion motion = Motion::kPursuit;           ///< `motion`, or `follower`.
  bool dynamic_window = false;                ///< Of pursuit: `follower: dwa`.
  GridPlanner planner = GridPlanner::kAstar;  ///< Of discrete motion.
  bool second_look = true;                    ///< Default: false with `parity: vlfm`.
  bool approach = true, sweep = true;         ///< The same.
  bool clean_cloud = true;                    ///< Only with `approach`; see VlfmOptions.
  double give_up_s = 45.0;                    ///< 0: never. Only with `sweep`.
  double min_score = 0.0;
  FusionRule fusion = FusionRule::kWeighted;
  ScorerSettings scorer;
  std::filesystem::path segmenter;  ///< Model (docs/models.md); empty: by depth.
  std::filesystem::path depth;      ///< `inferred_depth`, a model; empty: measured.
};

/// "random"
struct RandomSettings {
  double stop_chance = RandomPolicyOptions{}.stop_chance;
};

/// "script"
struct ScriptSettings {
  std::vector<DiscreteAction> actions;
};

/// "process"
struct ProcessSettings {
  core::PeerCommand peer;
};

/// "ros2": whoever answers on a ROS 2 network (docs/ros2.md).
struct Ros2Settings {
  int domain = 0;          ///< ROS_DOMAIN_ID, [0, 232].
  bool humble = false;     ///< `distro: humble`; else Iron and later.
  bool stamped = false;    ///< `cmd_vel: twist_stamped`; else Twist.
  bool waits = true;       ///< `commands: each`, one for an image; else `newest`, no waiting.
  double answer_s = 10.0;  ///< Wall time for a command.
  double start_s = 60.0;   ///< Wall time until somebody is there, at the start of a trial.
  bool detections = true;  ///< Those of the arm are published.
  bool depth_mm = false;   ///< `depth: 16uc1`; else 32FC1, in metres.
  // On request, as a robot does not know them:
  bool truth = false;     ///< Label image and boxes of every image.
  bool map = false;       ///< The scene's obstacles as an occupancy grid.
  bool fast_dds = false;  ///< `dds: fast`; else Cyclone DDS.
  std::string config;     ///< Of the implementation, as XML (ros/dds/transport.h).
  bool operator==(const Ros2Settings&) const = default;
};

/// Adds "frontier", "frontier-nearest", "frontier-value", "vlfm", "oracle-path", "random",
/// "script", "process" and "ros2".
void add_built_in_policies(PolicyRegistry& registry);

/// The built-in prior.
[[nodiscard]] const SemanticPrior& default_semantic_prior();

}  // namespace segsim::nav
