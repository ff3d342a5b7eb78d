#pragma once

/// @file
/// Policies by name, with the settings that a spec may give:
///
///     policy: frontier
///     policy: {type: vlfm, parity: fixed, quirks: {Q4: vlfm}, motion: discrete}
///     policy: {type: frontier, follower: dwa}
///     policy: {type: script, actions: [left*12, forward*4, stop]}

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/config.h"
#include "core/robot_base.h"
#include "core/stages.h"
#include "nav/objects/object_map.h"
#include "nav/policies/baseline_policies.h"
#include "nav/value/semantic_prior.h"
#include "nav/vlfm/vlfm_policy.h"

namespace segsim::nav {

struct PolicySettings {
  std::string type = "frontier";  ///< One of policy_names().
  // vlfm
  VlfmRules rules;               ///< `parity`, then `quirks`.
  std::optional<Motion> motion;  ///< Default: pursuit.
  bool dynamic_window = false;   ///< Of pursuit: `follower: dwa`; any frontier policy.
  GridPlanner planner = GridPlanner::kAstar;  ///< Of discrete motion.
  bool second_look = true;                    ///< Default: false with `parity: vlfm`.
  bool approach = true, sweep = true;         ///< The same.
  bool clean_cloud = true;                    ///< Only with `approach`; see VlfmOptions.
  double give_up_s = 45.0;                    ///< 0: never. Only with `sweep`.
  double min_score = 0.0;
  FusionRule fusion = FusionRule::kWeighted;
  // vlfm, frontier-value
  std::string scorer = "semantic-prior";  ///< Or "constant", "open-space".
  std::filesystem::path prior;  ///< Empty: the built-in nav/policies/data/semantic_prior.yaml.
  double rival_iou = ObjectMapOptions{}.rival_iou;  ///< Of the frontier policies.
  // script
  std::vector<DiscreteAction> actions;
  // random
  double stop_chance = 0.01;
};

/// "frontier" (also called "frontier-nearest"), "frontier-value", "vlfm", "oracle-path",
/// "random", "script".
[[nodiscard]] const std::vector<std::string>& policy_names();

/// Reads a name or a map. @param expand  Path of a node, with the spec's variables replaced.
/// @throws core::InputError with file, line and key.
[[nodiscard]] PolicySettings read_policy_settings(
    const core::ConfigNode& node,
    const std::function<std::filesystem::path(const core::ConfigNode&)>& expand);

/// What a policy may know of the trial besides its observations.
struct PolicyContext {
  std::vector<std::string> class_names;  ///< Of the detector.
  core::RobotBase robot;                 ///< It plans for this one.
  double camera_height_m = 1.2;          ///< Of the robot in this scene.
  PathOracle oracle;                     ///< Needed by "oracle-path" only.
};

/// @throws core::InputError if the prior's file is wrong.
[[nodiscard]] std::unique_ptr<core::Policy> make_policy(const PolicySettings& settings,
                                                        const PolicyContext& context);

/// The built-in prior.
[[nodiscard]] const SemanticPrior& default_semantic_prior();

}  // namespace segsim::nav
