#include "experiments/records/trial_outcome.h"

#include "core/name_table.h"

namespace segsim::experiments::records {
namespace {

constexpr core::NameTable<TrialOutcome, TrialOutcome::kError> kNames(
    "an outcome", {"success", "stopped_far", "not_visible", "timeout", "gave_up", "collision",
                   "aborted", "infeasible", "trivial", "error"});

// Those of the simulator come first, in its order.
static_assert(static_cast<int>(TrialOutcome::kAborted) ==
              static_cast<int>(sim::Outcome::kAborted));

}  // namespace

TrialOutcome trial_outcome(sim::Outcome outcome) { return static_cast<TrialOutcome>(outcome); }

std::optional<sim::Outcome> simulated(TrialOutcome outcome) {
  if (outcome > TrialOutcome::kAborted) return std::nullopt;
  return static_cast<sim::Outcome>(outcome);
}

const char* to_string(TrialOutcome outcome) { return kNames.name(outcome); }

TrialOutcome trial_outcome_from(std::string_view name, const std::string& place) {
  return kNames.read(name, place);
}

}  // namespace segsim::experiments::records
