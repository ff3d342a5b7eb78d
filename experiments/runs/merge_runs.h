#pragma once

/// @file
/// The parts of a run that several workers did, put together into one.

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "experiments/results/table.h"

namespace segsim::experiments::runs {

struct MergeReport {
  std::int64_t run_id = 0;
  int added = 0;               ///< Trials that were not there, or had failed in the harness.
  int known = 0;               ///< Trials that were there already, and are equal.
  int failed = 0;              ///< In the harness; left out where a finished one is there.
  std::string results_sha256;  ///< results_digest.h
  results::ResultTable table;
};

/// The folders of shards below a work folder, sorted; empty if there are none.
[[nodiscard]] std::vector<std::filesystem::path> shard_folders(
    const std::filesystem::path& work);

/// Adds the trials of the last run of each shard to the last run of `out`/results.sqlite, or
/// to a new one if there is none; links (or copies) their pictures, tracks, logs, ... into
/// `out`; writes the tables there. All trials come in by one transaction. Doing it again, in
/// another order, with a shard twice, or while workers are still at it is harmless.
/// @param shards  Folders with a results.sqlite, or such files.
/// @throws core::InputError, with nothing changed, if a shard is of another spec, version,
/// scene, episode set or weights, or if two finished trials of the same name differ.
MergeReport merge_runs(const std::filesystem::path& out,
                       std::span<const std::filesystem::path> shards);

}  // namespace segsim::experiments::runs
