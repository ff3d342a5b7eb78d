#pragma once

/// @file
/// The answer of an experiment: "Scene | SR-Before | SR-After", with everything that a reader
/// needs to judge it. Computed from trials alone; nothing here is stored.

#include <optional>
#include <string>
#include <vector>

#include "experiments/results/statistics.h"
#include "experiments/results/trial_insights.h"
#include "experiments/store/store.h"

namespace segsim::experiments {

/// One arm over a group of episodes. With several repetitions an episode counts as a success
/// if more than half of its repetitions succeed, and its other figures are means.
struct ArmSummary {
  std::string arm;
  Proportion success;                          ///< Episodes.
  double spl = 0, soft_spl = 0;                ///< Means over episodes.
  double sim_s = 0, path_m = 0, contacts = 0;  ///< Means over trials.
  double invalid_pixels = 0;  ///< Mean share of pixels where the reconstruction has a hole.
  std::vector<std::pair<std::string, int>>
      outcomes;  ///< Trials by outcome, most frequent first.
  int trials = 0, failed_trials = 0;
  int excluded_trials = 0;  ///< Infeasible or trivial episodes.
  TrialInsights insights;
};

/// After - before, mean over the pairs, with a bootstrap interval and a sign-flip test.
struct PairedMean {
  MeanInterval difference;
  double p = 1;
};

/// One row: a scene, a goal class, or all.
struct GroupSummary {
  std::string name, title;
  std::vector<ArmSummary> arms;  ///< In the order of the run's arms.
  PairedCounts pairs;            ///< Before against after.
  int dropped_pairs = 0;         ///< Episodes that miss a usable trial in one of the two arms.
  double p_exact = 1, p_mid = 1;
  double p_holm = 1;  ///< Corrected for the number of rows (goal classes).
  PairedMean spl, sim_s, path_m;
  PairedDifference difference;
  /// Of all scenes: difference of the success rates, with an interval from drawing scenes.
  std::optional<MeanInterval> over_scenes{};
  std::string verdict;
  bool leak = false;  ///< "After" was fine-tuned on this scene.

  [[nodiscard]] const ArmSummary* find(const std::string& arm) const;
};

struct ResultTable {
  RunRow run;
  std::vector<SceneRow> scene_rows;
  std::vector<ArmRow> arm_rows;
  std::string before, after;  ///< Names of the compared arms; empty if there are not two.
  std::string oracle;         ///< Name of the oracle arm; empty if none.
  std::vector<GroupSummary> scenes;
  std::optional<GroupSummary> all;  ///< If there is more than one scene.
  std::vector<GroupSummary> classes;
  int finished_trials = 0;
  std::vector<std::string> notes;  ///< Printed below the table, in order.
};

/// @param before, after Arms to compare; empty = the arms of these names, else the first two
/// that are not the oracle.
/// @throws core::InputError naming the arms if one does not exist.
[[nodiscard]] ResultTable summarise(const RunRow& run, const std::vector<SceneRow>& scenes,
                                    const std::vector<ArmRow>& arms,
                                    const std::vector<TrialRow>& trials,
                                    const std::string& before = {},
                                    const std::string& after = {});

/// LaTeX: a tabular of the package booktabs for each part.
enum class TableFormat : std::uint8_t { kText, kMarkdown, kCsv, kJson, kLatex };
/// @throws core::InputError for another word than text, md, csv, json, tex.
[[nodiscard]] TableFormat table_format_from(const std::string& word);
/// Every form, with the ending of its file: ".txt", ".md", ".csv", ".json", ".tex".
[[nodiscard]] const std::vector<std::pair<std::string, TableFormat>>& table_files();
[[nodiscard]] std::string format_table(const ResultTable& table, TableFormat format);

}  // namespace segsim::experiments
