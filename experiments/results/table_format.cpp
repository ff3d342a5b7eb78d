// Text, Markdown, LaTeX, CSV and JSON forms of a ResultTable.
#include <cstdio>
#include <span>

#include "experiments/internal/text_grid.h"
#include "experiments/results/internal/grid_document.h"
#include "experiments/results/internal/insight_grids.h"
#include "experiments/results/internal/leakage.h"
#include "experiments/results/internal/table_grids.h"
#include "experiments/results/internal/table_notes.h"
#include "experiments/results/table.h"

namespace segsim::experiments {
namespace {

using internal::compares;
using internal::find_arm;
using internal::print;

std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) result += c == '"' ? std::string("\"\"") : std::string(1, c);
  return result + "\"";
}

/// Long form: one line per group and arm, numbers in columns of their own.
std::string as_csv(const ResultTable& table) {
  std::string text =
      "kind,group,leak,arm,successes,episodes,sr,wilson_low,wilson_high,exact_low,exact_high,"
      "spl,"
      "soft_spl,sim_s,path_m,contacts,invalid_pixels,failed_trials,only_after,only_before,"
      "pairs,"
      "difference,difference_low,difference_high,p_exact,p_mid,p_holm,p_spl,verdict,leakage\n";
  const auto add = [&](const char* kind, const GroupSummary& group,
                       std::span<const SceneRow> scenes) {
    for (const ArmSummary& arm : group.arms) {
      const Interval wilson = wilson_interval(arm.success);
      const Interval exact = clopper_pearson_interval(arm.success);
      text += std::string(kind) + "," + quoted(group.name) + "," + (group.leak ? "1," : "0,") +
              quoted(arm.arm) + "," + std::to_string(arm.success.successes) + "," +
              std::to_string(arm.success.trials);
      for (const double value :
           {arm.success.value(), wilson.low, wilson.high, exact.low, exact.high, arm.spl,
            arm.soft_spl, arm.sim_s, arm.path_m, arm.contacts, arm.invalid_pixels}) {
        text += "," + print("%.6g", value);
      }
      text += "," + std::to_string(arm.failed_trials);
      // Comparisons stand on the line of the arm "after" only.
      if (compares(table) && arm.arm == table.after) {
        text += "," + std::to_string(group.pairs.only_after) + "," +
                std::to_string(group.pairs.only_before) + "," +
                std::to_string(group.pairs.total());
        for (const double value : {group.difference.difference, group.difference.interval.low,
                                   group.difference.interval.high, group.p_exact, group.p_mid,
                                   group.p_holm, group.spl.p}) {
          text += "," + print("%.6g", value);
        }
        text += "," + group.verdict;
      } else {
        text += ",,,,,,,,,,,";
      }
      text += "," + internal::leakage_word(*find_arm(table.arm_rows, arm.arm), scenes) + "\n";
    }
  };
  const std::span<const SceneRow> scenes(table.scene_rows);
  for (std::size_t i = 0; i < table.scenes.size(); ++i) {
    add("scene", table.scenes[i], scenes.subspan(i, 1));
  }
  if (table.all) add("all", *table.all, scenes);
  for (const GroupSummary& group : table.classes) add("class", group, scenes);
  return text;
}

}  // namespace

const std::vector<std::pair<std::string, TableFormat>>& table_files() {
  static const std::vector<std::pair<std::string, TableFormat>> files{
      {".txt", TableFormat::kText},
      {".md", TableFormat::kMarkdown},
      {".csv", TableFormat::kCsv},
      {".json", TableFormat::kJson},
      {".tex", TableFormat::kLatex}};
  return files;
}

std::string format_table(const ResultTable& table, TableFormat format) {
  if (format == TableFormat::kCsv) return as_csv(table);
  if (format == TableFormat::kJson) return internal::as_json(table);
  return internal::document_text({"", internal::grids_of(table), table.notes}, format);
}

}  // namespace segsim::experiments
