#pragma once

/// @file
/// A small run for the tests of tables: one scene, ten episodes, three arms.

#include <string>
#include <vector>

#include "experiments/results/table.h"

namespace segsim::experiments {

inline records::RunRow a_run(int planned) {
  records::RunRow run;
  run.run_id = 3;
  run.name = "demo";
  run.title = "Object search before and after fine-tuning";
  run.spec_sha256 = "0123456789abcdef";
  run.code_version = "0.1.0 (abc)";
  run.host = "host";
  run.success_profile = "segsim-object: STOP within 1 m";
  run.seed = 7;
  run.planned_trials = planned;
  run.started = "2026-01-31T12:00:00Z";
  return run;
}

inline const std::vector<records::SceneRow> kScenes{
    {"flat", "Flat", std::string(64, 'a'), std::string(64, 'b'), 10}};
inline const std::vector<records::ArmRow> kArms{
    {"before", "one.bin", std::string(64, 'c'), "", -1, {}},
    {"after", "two.bin", std::string(64, 'd'), "flat", -1,
     records::HeldOutPrecision{80, 0.5604, 0.3672, 0.244, 0.69, 0.57, 0.331},
     records::StartLeak{400, 0, 1.0}},
    {"oracle", "oracle", "", "", -1, {}}};

/// Ten episodes, five couches and five chairs: 2 both, 6 only after, 1 only before, 1 neither.
inline std::vector<records::TrialRow> ten_episodes() {
  const std::string before = "ss.....s..", after = "ssssssss..";
  std::vector<records::TrialRow> trials;
  for (int k = 0; k < 10; ++k) {
    const auto add = [&](const std::string& arm, bool success) {
      records::TrialRow t;
      t.arm = arm;
      t.scene = "flat";
      t.goal_class = k < 5 ? "couch" : "chair";
      t.episode = "flat/" + t.goal_class + "/0" + std::to_string(k);
      t.success = success;
      t.outcome = success ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
      t.spl = success ? 0.5 : 0.0;
      t.sim_s = 20;
      t.path_m = 4;
      trials.push_back(t);
    };
    const auto at = static_cast<std::size_t>(k);
    add("before", before[at] == 's' || k == 9);
    add("after", after[at] == 's');
    add("oracle", true);
  }
  return trials;
}

/// Failures of "before": four never saw the goal, two saw and missed it; of "after" none is
/// attributed (results of an older version).
inline std::vector<records::TrialRow> ten_attributed_episodes() {
  std::vector<records::TrialRow> trials = ten_episodes();
  int failures = 0;
  for (records::TrialRow& t : trials) {
    if (t.arm == "after") continue;
    t.ticks = 50;
    t.why.cause = t.success        ? records::Cause::kDidNotFail
                  : failures++ < 4 ? records::Cause::kNeverSawTarget
                                   : records::Cause::kFalseNegative;
    if (t.why.cause != records::Cause::kNeverSawTarget) t.why.visible_frames = 10;
    if (t.success) {
      t.first_visible_tick = 20;
      t.why.first_true_tick = 23;
      t.why.detected_frames = 6;
      t.why.stopped = true;
      t.stop_reason = core::StopReason::kGoalReached;
      t.why.final_visible_px = 100;
      t.why.object_m = t.why.planar_m = 0.0;
      t.why.shortest_object_m = 1.0;
      t.shortest_path_m = 2.0;  // Half of the path.
      t.distance_to_goal_m = 0.15;
    }
    t.why.false_detections = 1;
    t.why.false_clouds = t.success ? 0 : 1;
    t.why.misplaced_clouds = t.success ? 0 : 2;
  }
  return trials;
}

}  // namespace segsim::experiments
