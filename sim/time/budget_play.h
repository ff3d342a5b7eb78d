#pragma once

/// @file
/// A latency budget on its own: what a robot that drives nowhere would report.

#include "core/stages.h"
#include "sim/time/clock.h"
#include "sim/time/timing.h"

namespace segsim::sim {

struct BudgetPlayOptions {
  core::TimeNs control_period_ns = 100'000'000;
  core::TimeNs duration_ns = 60 * core::kNsPerSecond;
  std::uint64_t seed = 1;
  int items = 2;  ///< Detections of each image, for stages that charge them.
};

/// Plays the budget of a clock in virtual time with the rules of a trial (sim/trial/trial.h),
/// but without a world. Deterministic.
[[nodiscard]] TimingReport play_budget(const TrialClock& clock,
                                       const BudgetPlayOptions& options);

}  // namespace segsim::sim
