#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "experiments/records/store.h"

namespace segsim::tests {

/// Results of ten episodes in two arms: "after" gains seven and loses one.
inline void write_small_results(const std::filesystem::path& file) {
  experiments::records::RunRow run;
  run.name = run.title = "demo";
  run.success_profile = "segsim-object: STOP";
  run.planned_trials = 20;
  experiments::records::Store store(file);
  const std::int64_t id =
      store.begin_run(run, {{"room", "Room", "s", "e", 10}},
                      {{"before", "a", "c", "", -1, {}}, {"after", "b", "d", "room", -1, {}}});
  for (int k = 0; k < 10; ++k) {
    for (const std::string& arm : std::vector<std::string>{"before", "after"}) {
      experiments::records::TrialRow trial;
      trial.arm = arm;
      trial.scene = "room";
      trial.goal_class = "couch";
      trial.episode = "room/couch/" + std::to_string(k);
      trial.success = arm == "after" ? k < 8 : k == 0 || k == 9;
      trial.outcome = trial.success ? experiments::records::TrialOutcome::kSuccess
                                    : experiments::records::TrialOutcome::kTimeout;
      store.add_trial(id, trial);
    }
  }
}

}  // namespace segsim::tests
