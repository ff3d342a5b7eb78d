// Detectors, policies and arms of a spec.
#include <algorithm>

#include "experiments/specs/internal/spec_readers.h"
#include "experiments/support/numbers_in_range.h"

namespace segsim::experiments::specs::internal {
namespace {

using core::ConfigNode;

PretrainSpec read_pretrain(const ConfigNode& node) {
  PretrainSpec pretrain;
  pretrain.seed = read_seed(node, pretrain.seed);
  pretrain.rooms = support::count_within(node, "rooms", pretrain.rooms, 1, 100000);
  pretrain.views_per_room =
      support::count_within(node, "views_per_room", pretrain.views_per_room, 1, 100000);
  pretrain.steps = support::count_within(node, "steps", pretrain.steps, 1, 10000000);
  node.finish();
  return pretrain;
}

/// Names of the scenes in the pools that the key `pools` lists, in the order of the spec.
std::vector<std::string> scenes_of_pools(const ConfigNode& node,
                                         const std::vector<SceneSpec>& scenes) {
  if (node.has("scenes")) node.child("pools").fail("one of the keys scenes and pools", "both");
  std::vector<std::string> pools, wanted, chosen;
  for (const SceneSpec& scene : scenes) {
    const bool is_new = std::find(pools.begin(), pools.end(), scene.pool) == pools.end();
    if (!scene.pool.empty() && is_new) pools.push_back(scene.pool);
  }
  if (pools.empty()) node.child("pools").fail("scenes with the key pool", "none");
  for (const ConfigNode& element : node.list("pools")) {
    wanted.push_back(pools[core::one_of(element, element.as_text(), pools)]);
  }
  for (const SceneSpec& scene : scenes) {
    if (std::find(wanted.begin(), wanted.end(), scene.pool) != wanted.end()) {
      chosen.push_back(scene.name);
    }
  }
  if (chosen.empty()) node.child("pools").fail("at least one pool", "none");
  return chosen;
}

FinetuneSpec read_finetune(const ConfigNode& node, const std::vector<SceneSpec>& scenes) {
  FinetuneSpec finetune;
  finetune.seed = read_seed(node, finetune.seed);
  std::vector<std::string> names;
  names.reserve(scenes.size());
  for (const SceneSpec& scene : scenes) names.push_back(scene.name);
  finetune.scenes = names;
  if (node.has("scenes")) {
    finetune.scenes.clear();
    for (const ConfigNode& element : node.list("scenes")) {
      finetune.scenes.push_back(element.as_text());
      if (std::find(names.begin(), names.end(), finetune.scenes.back()) == names.end()) {
        const std::string near = core::nearest_word(finetune.scenes.back(), names);
        element.fail("the name of a scene of this spec",
                     "\"" + finetune.scenes.back() + "\"" +
                         (near.empty() ? "" : " (near: " + near + ")"));
      }
    }
  }
  if (node.has("pools")) finetune.scenes = scenes_of_pools(node, scenes);
  if (node.has("folds")) {
    const int most = static_cast<int>(finetune.scenes.size());
    finetune.folds = support::count_within(node, "folds", 0, 2, std::max(2, most));
  }
  finetune.views_per_scene =
      support::count_within(node, "views_per_scene", finetune.views_per_scene, 1, 100000);
  finetune.width_px = support::count_within(node, "width", 0, 0, 8192);
  finetune.height_px = support::count_within(node, "height", 0, 0, 8192);
  finetune.steps = support::count_within(node, "steps", finetune.steps, 1, 10000000);
  finetune.learning_rate = support::number_within(node, "learning_rate", 0.0, 0.0, 1.0);
  finetune.mix_share = support::number_within(node, "mix_share", 0.0, 0.0, 0.9);
  finetune.mix_rooms = support::count_within(node, "mix_rooms", finetune.mix_rooms, 1, 100000);
  finetune.facing_share =
      support::number_within(node, "facing_share", finetune.facing_share, 0.0, 1.0);
  finetune.validation_views_per_scene =
      support::count_within(node, "validation_views_per_scene", 0, 0, 100000);
  finetune.validation_facing_share = support::number_within(
      node, "validation_facing_share", finetune.validation_facing_share, 0.0, 1.0);
  finetune.measure_elsewhere = node.boolean_or("measure_elsewhere", true);
  finetune.precision_target = support::number_within(node, "precision_target", 0.0, 0.0, 0.99);
  finetune.start_clearance_m =
      support::number_within(node, "start_clearance_m", 0.0, 0.0, 10.0);
  finetune.threads = support::count_within(node, "threads", finetune.threads, 1, 1024);
  node.finish();
  return finetune;
}

}  // namespace

DetectorSpec read_detectors(const ConfigNode& root, const Variables& variables,
                            const SpecFolders& folders, const std::vector<SceneSpec>& scenes) {
  DetectorSpec detectors;
  detectors.before = folders.work / "detector-before.bin";
  detectors.after = folders.work / "detector-after.bin";
  const std::optional<ConfigNode> node = root.optional_child("detectors");
  if (!node) return detectors;
  if (node->has("before")) detectors.before = variables.expand(node->child("before"));
  if (node->has("after")) detectors.after = variables.expand(node->child("after"));
  if (const auto child = node->optional_child("pretrain")) {
    detectors.pretrain = read_pretrain(*child);
  }
  if (const auto child = node->optional_child("finetune")) {
    detectors.finetune = read_finetune(*child, scenes);
  }
  node->finish();
  return detectors;
}

nav::PolicyChoice read_policy(const ConfigNode& node, const Variables& variables) {
  return nav::PolicyRegistry::instance().read(
      node.child("policy"), [&](const ConfigNode& path) { return variables.expand(path); });
}

ArmSpec read_arm(const ConfigNode& node, const Variables& variables) {
  ArmSpec arm;
  arm.name = arm.family = read_name(node, "name");
  const ConfigNode given = node.child("detector");
  const std::optional<ConfigNode> python = core::python_peer_map(given);
  const bool process = python || given.is_map();
  const std::string detector = process ? "" : given.as_text();
  if (process) {
    const ConfigNode& map = python ? *python : given;
    (void)core::choice(map, "type", {"process"});
    arm.detector = ArmDetector::kProcess;
    arm.process = core::read_peer_command(
        map, [&](const ConfigNode& path) { return variables.expand(path); });
    map.finish();
  } else if (detector == "before") {
    arm.detector = ArmDetector::kBefore;
  } else if (detector == "after") {
    arm.detector = ArmDetector::kAfter;
  } else if (detector == "after-here") {
    arm.detector = ArmDetector::kAfterHere;
  } else if (detector == "after-elsewhere") {
    arm.detector = ArmDetector::kAfterElsewhere;
  } else if (detector == "after-exact") {
    arm.detector = ArmDetector::kAfterExact;
  } else if (detector == "oracle") {
    arm.detector = ArmDetector::kOracle;
  } else if (detector.find_first_of("/.$") != std::string::npos) {
    arm.detector = ArmDetector::kFile;
    arm.weights = variables.expand(node.child("detector"));
  } else {
    (void)core::choice(node, "detector",
                       {"before", "after", "after-here", "after-elsewhere", "after-exact",
                        "oracle", "a path of weights or of a model"});
  }
  if (node.has("open_detector")) {
    if (arm.detector == ArmDetector::kOracle) {
      node.child("open_detector").fail("none beside the oracle, which knows all", "one");
    }
    arm.open_detector = variables.expand(node.child("open_detector"));
    if (node.has("open_targets")) {
      for (const ConfigNode& element : node.list("open_targets")) {
        arm.open_targets.push_back(element.as_text());
      }
    }
  }
  if (node.has("policy")) arm.policy = read_policy(node, variables);
  if (node.has("score_threshold")) {
    if (arm.detector == ArmDetector::kProcess) {
      node.child("score_threshold").fail("none: a process chooses its own", "one");
    }
    arm.score_threshold = support::number_within(node, "score_threshold", 0.5, 0.0, 1.0);
  }
  arm.clock =
      read_arm_clock(node, [&](const ConfigNode& path) { return variables.expand(path); });
  node.finish();
  return arm;
}

}  // namespace segsim::experiments::specs::internal
