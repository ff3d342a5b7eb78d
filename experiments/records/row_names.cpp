#include "experiments/records/row_names.h"

#include "core/stop_reason.h"
#include "experiments/records/failure_cause.h"
#include "sim/trial/outcome.h"

namespace segsim::experiments::records {

void check_names(const TrialRow& row, const std::string& file) {
  const std::string place = file + ": trial " + std::to_string(row.trial_id) + ": ";
  if (row.counts()) (void)sim::outcome_from(row.outcome, place + "outcome");
  (void)core::stop_reason_from(row.stop_reason, place + "stop_reason");
  if (row.why.known()) (void)cause_from(row.why.cause, place + "cause");
}

}  // namespace segsim::experiments::records
