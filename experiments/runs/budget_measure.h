#pragma once

/// @file
/// A latency budget of this machine: what its own stages take in trials, as a file for
/// `clock: {mode: virtual, budget: FILE}`.

#include <map>
#include <string>
#include <vector>

#include "core/stages.h"
#include "experiments/specs/spec.h"
#include "sim/time/latency_budget.h"

namespace segsim::experiments::runs {

/// The spec with one arm alone, named "<arm>.measured", in measured time, and its logs.
/// @param arm  Empty: the first. @throws core::InputError if there is none of that name.
[[nodiscard]] specs::ExperimentSpec measured_spec(const specs::ExperimentSpec& spec,
                                                  const std::string& arm);

/// Durations of all images and decisions of the trials, by stage.
using StageDurations = std::map<std::string, std::vector<core::TimeNs>>;
void add_durations(const sim::LatencyTrace& trace, StageDurations& durations);

struct MeasuredBudget {
  std::string id;
  std::string origin;  ///< One line: processor, command, version.
  int processors = 1;  ///< For stages that share them.
  bool detects_on_gpu = false;
};

/// The budget (YAML) whose stages take lognormal times of the measured median and 95th
/// percentile. Where these are equal to a microsecond, a constant time.
/// @throws core::InputError if nothing was measured.
[[nodiscard]] std::string budget_text(const MeasuredBudget& about,
                                      const StageDurations& durations);

}  // namespace segsim::experiments::runs
