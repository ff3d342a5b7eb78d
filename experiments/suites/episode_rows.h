#pragma once

/// @file
/// The results of a suite, one row for each trial of an episode by an arm: what others compare
/// their own episodes with.

#include <ostream>

#include "experiments/results/stored_run.h"

namespace segsim::experiments::suites {

/// A header, then one line for each trial: suite, scene, pool, episode, goal, arm, training
/// (its own name), repetition, whether it counts, outcome, success by the rule of the suite
/// and by the strictest named one, SPL, SoftSPL, lengths [m], time [s], what the weights that
/// decided had seen of the scene, their hash, and the hash of all ticks.
void write_episodes_csv(std::ostream& out, const results::StoredRun& stored);
/// The same as JSON, an object on each line.
void write_episodes_jsonl(std::ostream& out, const results::StoredRun& stored);

}  // namespace segsim::experiments::suites
