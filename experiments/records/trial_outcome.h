#pragma once

/// @file
/// How a stored trial ended.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "sim/trial/outcome.h"

namespace segsim::experiments::records {

/// An outcome of the simulator, by the same name; or why there is none.
enum class TrialOutcome : std::uint8_t {
  kSuccess,
  kStoppedFar,
  kNotVisible,
  kTimeout,
  kGaveUp,
  kCollision,
  kAborted,
  kInfeasible,  ///< There was no trial: no way leads from the start to the goal.
  kTrivial,     ///< There was no trial: the robot stands at the goal when it begins.
  kError,       ///< The harness failed.
};

[[nodiscard]] TrialOutcome trial_outcome(sim::Outcome outcome);
/// None if there was no trial, or the harness failed.
[[nodiscard]] std::optional<sim::Outcome> simulated(TrialOutcome outcome);

/// The name in files: "success", ..., "infeasible", "trivial", "error".
[[nodiscard]] const char* to_string(TrialOutcome outcome);
/// @param place  Where the name was read, for the error message.
/// @throws core::InputError for a name that no outcome has.
[[nodiscard]] TrialOutcome trial_outcome_from(std::string_view name, const std::string& place);

}  // namespace segsim::experiments::records
