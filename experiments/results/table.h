#pragma once

/// @file
/// The answer of an experiment: "Scene | SR-Before | SR-After", with everything that a reader
/// needs to judge it. Computed from trials alone; nothing here is stored.

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "experiments/records/store.h"
#include "experiments/results/statistics.h"
#include "experiments/results/training_statistics.h"
#include "experiments/results/trial_insights.h"
#include "experiments/support/grid_document.h"

namespace segsim::experiments::results {

/// One arm of the spec over a group of episodes, all its trainings and reconstructions
/// together. With several repetitions an episode counts as a success if more than half of its
/// repetitions succeed, and its other figures are means.
struct ArmSummary {
  std::string arm;                      ///< Family (ArmRow).
  int members = 1;                      ///< Trainings and reconstructions of it.
  Proportion success;                   ///< Episodes, each once for each member.
  std::vector<Proportion> by_member{};  ///< Episodes of each, in the order of the run's arms.
  /// Of several members: hierarchical_rate_interval().
  std::optional<Interval> pooled_interval{};
  double spl = 0, soft_spl = 0;                ///< Means over those episodes.
  double sim_s = 0, path_m = 0, contacts = 0;  ///< Means over trials.
  double invalid_pixels = 0;  ///< Mean share of pixels where the reconstruction has a hole.
  std::vector<std::pair<std::string, int>>
      outcomes;  ///< Trials by outcome, most frequent first.
  int trials = 0, failed_trials = 0;
  int excluded_trials = 0;  ///< Infeasible or trivial episodes.
  TrialInsights insights;

  /// Of the success rate, 95 %: Wilson's of one training.
  [[nodiscard]] Interval interval() const {
    return pooled_interval ? *pooled_interval : wilson_interval(success);
  }
};

/// After - before, mean over the pairs. One training: with a bootstrap interval and a
/// sign-flip test; several: hierarchical_interval() and training_test().
struct PairedMean {
  MeanInterval difference;
  double p = 1;
};

/// One row: a scene (with its reconstructions), a goal class, or all.
struct GroupSummary {
  std::string name, title;
  std::vector<ArmSummary> arms;  ///< In the order of the run's arms.
  PairedCounts pairs;            ///< Before against after, over all trainings.
  int dropped_pairs = 0;         ///< Pairs that miss a usable trial in one of the two arms.
  /// What decides: McNemar's exact p; of several trainings that of training_test().
  double p = 1;
  double p_mid = 1;   ///< McNemar's, of one training.
  double p_holm = 1;  ///< Corrected for the number of rows (goal classes).
  std::optional<TrainingTest> training{};  ///< Of several trainings.
  PairedMean spl, sim_s, path_m;
  /// Of one training Newcombe's interval, of several hierarchical_interval().
  PairedDifference difference;
  /// Of all scenes, one training: difference of the success rates, with an interval from
  /// drawing scenes.
  std::optional<MeanInterval> over_scenes{};
  std::string verdict;
  bool leak = false;                  ///< "After" was fine-tuned on this scene.
  std::vector<std::string> scenes{};  ///< Families, of a pool.

  [[nodiscard]] const ArmSummary* find(const std::string& arm) const;
};

/// One arm over all scenes, or those of a pool: does what it learnt carry over?
struct Generalisation {
  std::string group, arm;  ///< Title of the group; family of the arm.
  std::size_t scenes = 0;
  ArmSummary summary;
  std::string leakage;  ///< "none", "scene" or "unknown": of what decides in each scene.
  /// SR - SR of "before" on the same episodes; none of "before" itself. One training: with the
  /// interval of a cluster bootstrap over scenes; several: hierarchical_interval().
  std::optional<MeanInterval> difference{};
};

/// One training of the arm under test, over all scenes.
struct TrainingSummary {
  std::string arm, before;  ///< Names of the rows: "after.s3" against "before".
  Proportion success;       ///< Episodes.
  PairedCounts pairs;
};

/// Leakage by view: successful trials of the arm under test that ended near a view that it was
/// fine-tuned on and that shows the goal.
struct StopRegion {
  int successes = 0;      ///< Of trials where this is known.
  int near_views = 0;     ///< Of these, ended within records::kStopRegion_m of such a view.
  double mean_views = 0;  ///< Such views of a successful trial.
};

struct ResultTable {
  records::RunRow run;
  std::vector<records::SceneRow> scene_rows;
  std::vector<records::ArmRow> arm_rows;
  std::string before, after;  ///< The compared arms (families); empty if there are not two.
  std::string oracle;         ///< The oracle arm; empty if none.
  /// Rows of the arms that are compared with one another: one pair for each training.
  std::vector<TrainingSummary> trainings;
  /// Whether trained weights are what is compared: then `trainings` are draws of chance, and a
  /// table of one says so.
  bool compares_trainings = false;
  std::vector<GroupSummary> scenes;
  std::optional<GroupSummary> all;  ///< If there is more than one scene.
  std::vector<GroupSummary> pools;  ///< Of scenes, if the spec has several.
  /// Of runs with pools, or with arms that have weights of their own in every scene.
  std::vector<Generalisation> generalisation;
  std::vector<GroupSummary> classes;
  int finished_trials = 0;
  std::optional<StopRegion> stop_region{};  ///< None if nothing was fine-tuned here.
  std::vector<std::string> notes;           ///< Printed below the table, in order.
};

/// @param before, after Arms to compare, with all their trainings, or one row of an arm
/// ("after.s3"); empty = the arms of these names, else the first two that are not the oracle.
/// @throws core::InputError naming the arms if one does not exist, or if their trainings do
/// not pair.
[[nodiscard]] ResultTable summarise(const records::RunRow& run,
                                    const std::vector<records::SceneRow>& scenes,
                                    const std::vector<records::ArmRow>& arms,
                                    const std::vector<records::TrialRow>& trials,
                                    const std::string& before = {},
                                    const std::string& after = {});

/// LaTeX: a tabular of the package booktabs for each part.
/// @throws core::InputError for another word than text, md, csv, json, tex.
[[nodiscard]] support::TableFormat table_format_from(const std::string& word);
/// Every form, with the ending of its file: ".txt", ".md", ".csv", ".json", ".tex".
[[nodiscard]] const std::vector<std::pair<std::string, support::TableFormat>>& table_files();
/// Writes a table in every form: NAME.txt, NAME.md, ...
/// @param text  The table in one form.
/// @throws core::InputError if a file cannot be written.
void write_table_files(const std::filesystem::path& folder, const std::string& name,
                       const std::function<std::string(support::TableFormat)>& text);
[[nodiscard]] std::string format_table(const ResultTable& table, support::TableFormat format);

}  // namespace segsim::experiments::results
