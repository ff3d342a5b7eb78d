#pragma once

/// @file
/// A run for other programs, complete: JSON Lines. CSV of the trials alone is
/// write_trials_csv().

#include <ostream>

#include "experiments/results/stored_run.h"

namespace segsim::experiments::results {

/// The first line is the run: {"schema": "segsim.trials/1", "run": {...}, "scenes": [...],
/// "arms": [...]} with the text of its spec, hashes and leakage; then a line per trial with
/// every column of the store, null where there is none. Lines are ordered as Store::trials().
void write_trials_jsonl(std::ostream& out, const StoredRun& stored);

}  // namespace segsim::experiments::results
