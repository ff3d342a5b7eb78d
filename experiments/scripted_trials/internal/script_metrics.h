#pragma once

/// @file
/// The numbers of a scripted trial, and whether they are what was expected.

#include <map>
#include <string>
#include <vector>

#include "experiments/scripted_trials/scripted_run.h"

namespace segsim::experiments::scripted_trials {

/// The step that was under way at that time (the robot's clock); -1: none.
[[nodiscard]] int step_at(const std::vector<StepOutcome>& steps, core::TimeNs time_ns);

/// Fills in everything beyond the trial, its steps and finds.
/// @param goals  View points by category of the kFind steps.
void measure(const BoundScript& bound, const std::map<std::string, sim::Episode>& goals,
             ScriptedResult& result);

/// The metric's number; none if the trial has none, for example the age of an image that never
/// came.
[[nodiscard]] std::optional<double> value_of(const Expectation& expectation,
                                             const ScriptedResult& result);

}  // namespace segsim::experiments::scripted_trials
