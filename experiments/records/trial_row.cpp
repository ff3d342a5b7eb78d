#include "experiments/records/trial_row.h"

#include <limits>

namespace segsim::experiments::records {

sim::TrialEnd trial_end(const TrialRow& trial) {
  sim::TrialResult result;
  result.stop_reason = trial.stop_reason;
  result.distance_to_goal_m =
      trial.distance_to_goal_m.value_or(std::numeric_limits<double>::infinity());
  result.contacts = trial.contacts;
  result.sim_s = trial.sim_s;
  result.path_m = trial.path_m;
  result.shortest_path_m = trial.shortest_path_m;
  return trial_end(trial.why, result);
}

}  // namespace segsim::experiments::records
