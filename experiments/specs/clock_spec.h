#pragma once

/// @file
/// How time passes in the trials of a spec (docs/simulation.md):
///
///     clock:
///       mode: virtual              # lockstep (default) | virtual | measured | realtime
///       budget: ${spec}/../budgets/example-edge.yaml
///       camera: {period_ms: 50, phase_ms: 0, jitter_ms: 2}   # default: every control period
///       registration: capture      # or use: labels are placed with the pose of the decision
///       scale: 1.0                 # of measured times: how much slower the robot's computer
///       is
///
/// An arm may have a budget of its own and more time for single stages:
///
///     - {name: slow, detector: oracle, budget: FILE, add_ms: {detect: 200}}

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "core/config.h"
#include "experiments/specs/budget_file.h"
#include "sim/time/clock.h"

namespace segsim::experiments::specs {

/// A path of the spec with its variables replaced.
using ExpandPath = std::function<std::filesystem::path(const core::ConfigNode&)>;

struct ClockSpec {
  sim::ClockMode mode = sim::ClockMode::kLockstep;
  std::optional<BudgetFile> budget;
  sim::SensorRate camera;
  sim::Registration registration = sim::Registration::kCapture;
  double measured_scale = 1.0;
};

struct ArmClockSpec {
  std::optional<BudgetFile> budget;      ///< None: the spec's.
  std::map<std::string, double> add_ms;  ///< By stage.
  [[nodiscard]] bool given() const { return budget || !add_ms.empty(); }
};

/// The key `clock` of a spec; the default if it is absent.
[[nodiscard]] ClockSpec read_clock_spec(const core::ConfigNode& root,
                                        const ExpandPath& expand);
/// The keys `budget` and `add_ms` of an arm.
[[nodiscard]] ArmClockSpec read_arm_clock(const core::ConfigNode& arm,
                                          const ExpandPath& expand);
/// Refuses what does not fit: a budget or added time in lockstep, virtual time without a
/// budget, time added to a stage that the budget lacks. @param arm  For the message's place.
void check_arm_clock(const ClockSpec& clock, const ArmClockSpec& arm_clock,
                     const core::ConfigNode& arm);

/// What the trials of an arm are run with.
[[nodiscard]] sim::TrialClock trial_clock(const ClockSpec& clock, const ArmClockSpec& arm);

/// "virtual time, budget example-edge"; "" in lockstep.
[[nodiscard]] std::string clock_in_words(const ClockSpec& clock);

}  // namespace segsim::experiments::specs
