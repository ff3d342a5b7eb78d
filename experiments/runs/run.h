#pragma once

/// @file
/// Runs an experiment: prepares what is missing, runs the trials that are not done, prints the
/// table. It can be killed at any time and started again: finished trials are kept.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "experiments/reproducibility/stage_digests.h"
#include "experiments/results/table.h"
#include "experiments/runs/shard.h"
#include "experiments/specs/spec.h"
#include "experiments/support/stage_times.h"

namespace segsim::experiments::runs {

struct RunOptions {
  specs::SpecFolders folders;
  int workers = 2;
  bool new_run = false;  ///< Begin again although a run with this spec, or another, is there.
  bool prepare_only = false;      ///< Stop before the first trial.
  int max_trials = 0;             ///< Stop after so many trials; 0 = all.
  std::filesystem::path results;  ///< For the database and the tables; empty: the work folder.
  /// One part of the run, beside workers with the others; its results lie in shards/I-of-N
  /// below `results`, for merge_runs(). Not with `new_run` or `prepare_only`.
  std::optional<Shard> shard{};
};

struct RunReport {
  std::int64_t run_id = 0;
  int trials_run = 0, trials_left = 0;    ///< Of the shard, if there is one.
  int trials_failed = 0;                  ///< In the harness; they run again on resume.
  bool interrupted = false;               ///< By SIGINT or SIGTERM, during trials.
  double store_s = 0;                     ///< Spent on adding trials to the database.
  std::vector<support::StageTime> times;  ///< Of this call.
  double wall_s = 0;                      ///< Of all of it.
  std::filesystem::path results;
  std::string results_sha256;  ///< results_digest.h
  results::ResultTable table;  ///< Empty of a shard.
  std::vector<reproducibility::StageDigest>
      digests;  ///< Empty of a shard; in digests.json, too.
};

/// Results lie in the work folder: results.sqlite, table.{txt,md,csv,json}, trials.csv,
/// pictures/, tracks/, logs/, videos/, frames/, episodes/. Rows do not depend on the number of
/// workers (wall times excepted).
/// With `shard`, others may work in the folder at the same time: whoever comes first makes
/// what is missing, and the others wait for it.
/// @throws core::InputError if the spec or a prepared input changed since the run began
///         (unless `new_run`), another process works in the folder, or results cannot be
///         written (what is in is kept); Interrupted by a signal before the first trial.
RunReport run_experiment(const specs::ExperimentSpec& spec, const RunOptions& options);

/// "segsim-object: STOP within 1 m (geodesic) of a view point ..., within 180 s".
[[nodiscard]] std::string success_in_words(const specs::ExperimentSpec& spec);

/// Writes table.* and trials.csv to the work folder.
void write_tables(const std::filesystem::path& work, const results::ResultTable& table,
                  const std::vector<records::TrialRow>& trials);

}  // namespace segsim::experiments::runs
