#include "experiments/records/row_names.h"

#include <filesystem>

#include "core/error.h"
#include "core/stop_reason.h"
#include "experiments/records/failure_cause.h"
#include "sim/trial/outcome.h"

namespace segsim::experiments::records {

namespace {

/// A database from elsewhere must not make the program open other files.
void check_file(const std::string& file, const std::string& place) {
  const std::filesystem::path path = std::filesystem::path(file).lexically_normal();
  if (path.is_relative() && (path.empty() || *path.begin() != "..")) return;
  throw core::InputError::expected(place, "a file below the folder of the run",
                                   "\"" + file + "\"");
}

}  // namespace

void check_names(const TrialRow& row, const std::string& file) {
  const std::string place = file + ": trial " + std::to_string(row.trial_id) + ": ";
  if (row.counts()) (void)sim::outcome_from(row.outcome, place + "outcome");
  (void)core::stop_reason_from(row.stop_reason, place + "stop_reason");
  if (row.why.known()) (void)cause_from(row.why.cause, place + "cause");
  check_file(row.log, place + "log");
  check_file(row.picture, place + "picture");
  check_file(row.video, place + "video");
  check_file(row.track, place + "track");
}

}  // namespace segsim::experiments::records
