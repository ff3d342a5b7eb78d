#pragma once

/// @file
/// All results of an experiment in one SQLite file. A trial is either wholly in or absent (one
/// transaction each, write-ahead log), so a killed run loses at most the trials in flight, and
/// a machine without power also those of its last kSyncPeriod_s. What can be computed from
/// trials (rates, tests) is not stored.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <ostream>
#include <span>
#include <string>
#include <vector>

#include "experiments/records/run_rows.h"
#include "experiments/records/trial_row.h"

namespace segsim::experiments::records {

/// One writer at a time. Not thread-safe: the caller serialises.
class Store {
 public:
  static constexpr int kSchemaVersion = 8;  ///< Files of versions 1 to 7 are brought up to it.
  /// A trial is on the disk, not only in the system's memory, after so long.
  static constexpr double kSyncPeriod_s = 5.0;

  /// Opens the file, or makes it.
  /// @throws core::InputError if it is no such database or has another schema version.
  explicit Store(const std::filesystem::path& file);
  /// For those who look on: opens an existing file without a change to it, and shows its state
  /// of that moment whatever is written meanwhile.
  /// @throws core::InputError also for a file of an older schema version.
  [[nodiscard]] static Store for_reading(const std::filesystem::path& file);
  ~Store();
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  /// @return  The run's id. `run.run_id` and `run.started` are ignored.
  std::int64_t begin_run(const RunRow& run, const std::vector<SceneRow>& scenes,
                         const std::vector<ArmRow>& arms);
  void end_run(std::int64_t run_id);
  /// Adds to RunRow::provenance, or replaces what is there under that name.
  void set_provenance(std::int64_t run_id, const std::string& name, const std::string& value);

  /// All runs, oldest first.
  [[nodiscard]] std::vector<RunRow> runs() const;
  [[nodiscard]] std::vector<SceneRow> scenes(std::int64_t run_id) const;
  [[nodiscard]] std::vector<ArmRow> arms(std::int64_t run_id) const;

  /// Adds a trial in a transaction of its own. It takes the place of an earlier one that
  /// failed.
  /// @throws core::InputError if the trial is there already (key: run, arm, episode,
  /// repetition).
  void add_trial(std::int64_t run_id, const TrialRow& trial);
  /// All of them or, if one cannot be added, none.
  void add_trials(std::int64_t run_id, std::span<const TrialRow> trials);

  /// Ordered by scene, episode, repetition, arm, whatever the order in which they were added.
  [[nodiscard]] std::vector<TrialRow> trials(std::int64_t run_id) const;

  /// When the newest trials finished: UTC, ISO 8601, newest first, at most `count`.
  [[nodiscard]] std::vector<std::string> finish_times(std::int64_t run_id, int count) const;

 private:
  struct Impl;
  explicit Store(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// One line per trial with a header line. Numbers that do not exist are empty fields.
void write_trials_csv(std::ostream& out, const std::vector<TrialRow>& trials);

/// Now, as "2026-01-31T12:00:00Z".
[[nodiscard]] std::string utc_now();

}  // namespace segsim::experiments::records
