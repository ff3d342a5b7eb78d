#pragma once

/// @file
/// All results of an experiment in one SQLite file. A trial is either wholly in or absent (one
/// transaction each, write-ahead log), so a killed run loses at most the trials in flight, and
/// a machine without power also those of its last kSyncPeriod_s. What can be computed from
/// trials (rates, tests) is not stored.

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <vector>

#include "experiments/records/held_out_precision.h"
#include "experiments/records/scene_exposure.h"
#include "experiments/records/trial_witness.h"

namespace segsim::experiments {

/// Where the numbers come from. `libraries`, `host`: free text.
struct RunRow {
  std::int64_t run_id = 0;
  std::string name, title;
  std::string spec_sha256, spec_text;
  std::string code_version, host, libraries;
  std::string success_profile;  ///< In words, with its parameters.
  std::uint64_t seed = 0;
  int planned_n = 0;           ///< Episodes per arm and scene; 0 = all.
  int planned_trials = 0;      ///< Over all arms.
  std::string started, ended;  ///< UTC, ISO 8601; `ended` is empty while trials are missing.
  /// What else a result may depend on, by name: "clock", "library/<name>",
  /// "training_scenes/<arm>", "leakage/<arm>" (from ArmRow::exposure), "time/<stage>",
  /// "shard"; of merged runs "merged/<shard>".
  std::map<std::string, std::string> provenance{};
};

struct SceneRow {
  std::string name, title;
  std::string scene_sha256;     ///< Of the bundle's manifest.
  std::string episodes_sha256;  ///< Of the episode file.
  std::int64_t episodes = 0;
  /// Of the set's validation by the oracle-path arm; -1: not validated.
  int oracle_successes = -1, oracle_episodes = -1;
  std::string family{};    ///< Of all reconstructions of one scene; empty means `name`.
  int reconstruction = 1;  ///< Which of them this is.
};

struct ArmRow {
  std::string name;
  std::string detector;        ///< "oracle" or the name of the weight file.
  std::string weights_sha256;  ///< Empty for the oracle.
  std::string
      tuned_on;  ///< Names of scenes whose views it was fine-tuned on, with ", " between.
  double score_threshold = -1;               ///< -1: the one stored with the weights.
  std::optional<HeldOutPrecision> held_out;  ///< None for the oracle and foreign weights.
  std::optional<StartLeak> start_leak{};     ///< None if it was not fine-tuned here.
  /// None for the oracle, and in results of versions that did not look.
  std::optional<SceneExposure> exposure{};
  std::string family{};    ///< Of all trainings of one arm of the spec; empty means `name`.
  int reconstruction = 1;  ///< It ran in these scenes only.
  std::optional<std::uint64_t> finetune_seed{};  ///< None if it was not fine-tuned here.
};

/// Of a SceneRow or ArmRow.
template <class Row>
[[nodiscard]] const std::string& family_of(const Row& row) {
  return row.family.empty() ? row.name : row.family;
}

/// One finished trial. Columns as in sim::TrialResult; -1 ticks and unset values are "never".
struct TrialRow {
  std::int64_t trial_id = 0;  ///< Given by the store.
  std::string arm, scene, episode, goal_class;
  int repetition = 0;
  /// sim::to_string(Outcome); "error"; or "infeasible", "trivial": there was no trial.
  std::string outcome;
  bool success = false;
  std::string stop_reason;
  double spl = 0, soft_spl = 0;
  double path_m = 0, shortest_path_m = 0;
  std::optional<double> distance_to_goal_m;  ///< None: off the navigable area.
  double sim_s = 0, wall_s = 0;
  int ticks = 0, contacts = 0;
  double contact_s = 0;
  int first_visible_tick = -1, first_detected_tick = -1;
  double invalid_pixel_fraction = 0;
  std::uint64_t state_hash = 0;
  double render_ms = 0, detect_ms = 0, policy_ms = 0;
  std::string error;  ///< Message of a failed harness; such trials run again on resume.
  std::string picture, video, track;  ///< Files, relative to the work folder; empty if none.

  std::string log;  ///< File, relative to the work folder (trial_log.h); empty if none.
  Attribution why;
  std::string finished;  ///< UTC, ISO 8601; empty: when it is added.

  [[nodiscard]] bool failed() const { return outcome == "error"; }
  /// Whether it enters rates.
  [[nodiscard]] bool counts() const {
    return !failed() && outcome != "infeasible" && outcome != "trivial";
  }
};

/// One writer at a time. Not thread-safe: the caller serialises.
class Store {
 public:
  static constexpr int kSchemaVersion = 7;  ///< Files of versions 1 to 6 are brought up to it.
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

}  // namespace segsim::experiments
