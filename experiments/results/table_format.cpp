// Text, Markdown, LaTeX, CSV and JSON forms of a ResultTable.
#include <cstdio>
#include <ostream>

#include "core/file_io.h"
#include "core/formatted.h"
#include "experiments/results/insight_grids.h"
#include "experiments/results/leakage.h"
#include "experiments/results/table.h"
#include "experiments/results/table_grids.h"
#include "experiments/results/table_notes.h"
#include "experiments/support/grid_document.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::results {
namespace {

using core::print;
using internal::compares;

std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) result += c == '"' ? std::string("\"\"") : std::string(1, c);
  return result + "\"";
}

/// A training as a group of its own, over all scenes.
GroupSummary of_one(const TrainingSummary& training) {
  GroupSummary group;
  group.name = training.arm;
  ArmSummary arm;
  arm.arm = training.arm;
  arm.success = training.success;
  group.arms = {arm};
  group.pairs = training.pairs;
  group.difference = newcombe_paired_difference(training.pairs);
  group.p = group.p_holm =
      mcnemar_exact_p(training.pairs.only_after, training.pairs.only_before);
  group.p_mid = mcnemar_mid_p(training.pairs.only_after, training.pairs.only_before);
  group.verdict = verdict(training.pairs);
  return group;
}

/// Long form: one line per group and arm, numbers in columns of their own.
std::string as_csv(const ResultTable& table) {
  std::string text =
      "kind,group,leak,arm,successes,episodes,sr,wilson_low,wilson_high,exact_low,exact_high,"
      "spl,"
      "soft_spl,sim_s,path_m,contacts,invalid_pixels,failed_trials,only_after,only_before,"
      "pairs,"
      "difference,difference_low,difference_high,p_exact,p_mid,p_holm,p_spl,verdict,trainings,"
      "p,leakage\n";
  const auto add = [&](const std::string& kind, const GroupSummary& group) {
    const bool one = kind == "training";
    for (const ArmSummary& arm : group.arms) {
      // Of several trainings the columns of both intervals hold theirs.
      const Interval wilson = arm.interval();
      const Interval exact =
          arm.pooled_interval.value_or(clopper_pearson_interval(arm.success));
      text += kind + "," + quoted(group.name) + "," + (group.leak ? "1," : "0,") +
              quoted(arm.arm) + "," + std::to_string(arm.success.successes) + "," +
              std::to_string(arm.success.trials);
      for (const double value :
           {arm.success.value(), wilson.low, wilson.high, exact.low, exact.high, arm.spl,
            arm.soft_spl, arm.sim_s, arm.path_m, arm.contacts, arm.invalid_pixels}) {
        text += "," + print("%.6g", value);
      }
      text += "," + std::to_string(arm.failed_trials);
      // Comparisons stand on the line of the arm "after" only.
      if (one || (compares(table) && arm.arm == table.after)) {
        text += "," + std::to_string(group.pairs.only_after) + "," +
                std::to_string(group.pairs.only_before) + "," +
                std::to_string(group.pairs.total());
        for (const double value : {group.difference.difference, group.difference.interval.low,
                                   group.difference.interval.high}) {
          text += "," + print("%.6g", value);
        }
        text += group.training ? ",," : print(",%.6g", group.p) + print(",%.6g", group.p_mid);
        text += print(",%.6g", group.p_holm) + (one ? "," : print(",%.6g", group.spl.p));
        text +=
            "," + group.verdict + "," + std::to_string(arm.members) + print(",%.6g", group.p);
      } else {
        text += ",,,,,,,,,,,," + std::to_string(arm.members) + ",";
      }
      const std::string leakage =
          one ? internal::leakage_word(table, *internal::find_arm(table.arm_rows, arm.arm))
          : kind == "pool"
              ? internal::leakage_word(table, arm.arm, group.scenes)
              : internal::leakage_word(table, arm.arm, kind == "scene" ? group.name : "");
      text += "," + leakage + "\n";
    }
  };
  for (const GroupSummary& group : table.scenes) add("scene", group);
  for (const GroupSummary& group : table.pools) add("pool", group);
  if (table.all) add("all", *table.all);
  for (const GroupSummary& group : table.classes) add("class", group);
  if (table.trainings.size() > 1) {
    for (const TrainingSummary& training : table.trainings) add("training", of_one(training));
  }
  return text;
}

}  // namespace

const std::vector<std::pair<std::string, support::TableFormat>>& table_files() {
  static const std::vector<std::pair<std::string, support::TableFormat>> files{
      {".txt", support::TableFormat::kText},
      {".md", support::TableFormat::kMarkdown},
      {".csv", support::TableFormat::kCsv},
      {".json", support::TableFormat::kJson},
      {".tex", support::TableFormat::kLatex}};
  return files;
}

void write_table_files(const std::filesystem::path& folder, const std::string& name,
                       const std::function<std::string(support::TableFormat)>& text) {
  for (const auto& [ending, format] : table_files()) {
    const std::string form = text(format);
    core::write_file_atomically(folder / (name + ending),
                                [&](std::ostream& out) { out << form; });
  }
}

std::string format_table(const ResultTable& table, support::TableFormat format) {
  if (format == support::TableFormat::kCsv) return as_csv(table);
  if (format == support::TableFormat::kJson) return internal::as_json(table);
  return support::internal::document_text({"", internal::grids_of(table), table.notes},
                                          format);
}

}  // namespace segsim::experiments::results
