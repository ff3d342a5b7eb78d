#pragma once

/// @file
/// What of a trial must not depend on where and when it ran. Equal digests mean equal tables.

#include <string>
#include <vector>

#include "experiments/records/store.h"

namespace segsim::experiments::records {

/// Every column but ids, times of the wall clock, and names of files, as one line. Real
/// numbers are written exactly.
[[nodiscard]] std::string essence_of(const TrialRow& trial);

/// SHA-256 over the essences of finished trials, in the order of Store::trials(); those whose
/// harness failed are left out, as they will run again. In it is every trial's state hash, the
/// chain over all its ticks.
[[nodiscard]] std::string results_sha256(const std::vector<TrialRow>& trials);

}  // namespace segsim::experiments::records
