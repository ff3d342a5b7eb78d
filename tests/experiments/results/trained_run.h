#pragma once

/// @file
/// A run of several trainings for the tests of tables, in one reconstruction or two.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "experiments/results/table.h"

namespace segsim::experiments {

inline records::TrialRow a_trial(const std::string& scene, const std::string& arm,
                                 std::size_t episode, bool success) {
  records::TrialRow t;
  t.arm = arm;
  t.scene = scene;
  t.goal_class = episode < 2 ? "couch" : "chair";
  t.episode = "flat/" + t.goal_class + "/0" + std::to_string(episode);
  t.success = success;
  t.outcome = success ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
  t.spl = success ? 0.5 : 0.0;
  t.sim_s = 20;
  t.path_m = 4;
  return t;
}

inline records::ArmRow a_row(const std::string& name, const std::string& family,
                             int reconstruction, std::optional<std::uint64_t> seed) {
  records::ArmRow row{name,
                      name + ".weights",
                      std::string(64, family == "before" ? 'b' : 'a'),
                      "",
                      -1,
                      records::HeldOutPrecision{80, 0.5, 0.3, 0.25, 0.7, 0.6}};
  row.family = family;
  row.reconstruction = reconstruction;
  row.finetune_seed = seed;
  if (seed) row.tuned_on = reconstruction == 1 ? "flat" : "flat.r2";
  if (seed) row.start_leak = records::StartLeak{100, 3, 0.5};
  return row;
}

/// Four episodes; two trainings in the first reconstruction, one in the second.
struct Trained {
  std::vector<records::SceneRow> scenes{{"flat", "Flat", "s", "e", 4},
                                        {"flat.r2", "Flat, 2", "t", "f", 4}};
  std::vector<records::ArmRow> arms{
      a_row("before", "before", 1, {}), a_row("after", "after", 1, 2),
      a_row("after.s3", "after", 1, 3), a_row("before.r2", "before", 2, {}),
      a_row("after.r2", "after", 2, 2)};
  std::vector<records::TrialRow> trials;

  explicit Trained(bool second_reconstruction) {
    scenes[1].family = "flat";
    scenes[1].reconstruction = 2;
    add("flat", "before", "s...");
    add("flat", "after", "ss.s");     // +2 -0
    add("flat", "after.s3", ".ss.");  // +2 -1
    if (second_reconstruction) {
      add("flat.r2", "before.r2", "ss..");
      add("flat.r2", "after.r2", "sss.");  // +1 -0
    } else {
      scenes.pop_back();
      arms.resize(3);
    }
  }
  void add(const std::string& scene, const std::string& arm, const std::string& outcomes) {
    for (std::size_t k = 0; k < outcomes.size(); ++k) {
      trials.push_back(a_trial(scene, arm, k, outcomes[k] == 's'));
    }
  }
};

}  // namespace segsim::experiments
