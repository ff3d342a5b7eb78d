// Text, Markdown, CSV and JSON forms of a ResultTable.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "experiments/internal/insight_grids.h"
#include "experiments/table.h"

namespace segsim::experiments {
namespace {

using internal::compares;
using internal::Grid;
using internal::share_text;

std::string print(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string p_text(double p) { return p < 0.001 ? print("%.1e", p) : print("%.3f", p); }

/// "12/20  60 % [39, 78]"
std::string rate_text(const ArmSummary* arm) {
  if (arm == nullptr || arm->success.trials == 0) return "-";
  const Interval interval = wilson_interval(arm->success);
  return std::to_string(arm->success.successes) + "/" + std::to_string(arm->success.trials) +
         "  " + print("%.0f", 100.0 * arm->success.value()) + " % [" +
         print("%.0f", 100.0 * interval.low) + ", " + print("%.0f", 100.0 * interval.high) +
         "]";
}

std::string difference_text(const GroupSummary& group) {
  if (group.pairs.total() == 0) return "-";
  const PairedDifference& d = group.difference;
  return print("%+.0f", 100.0 * d.difference) + " [" + print("%+.0f", 100.0 * d.interval.low) +
         ", " + print("%+.0f", 100.0 * d.interval.high) + "]";
}

std::string pairs_text(const GroupSummary& group) {
  return "+" + std::to_string(group.pairs.only_after) + " -" +
         std::to_string(group.pairs.only_before) + " of " +
         std::to_string(group.pairs.total());
}

Grid comparison_grid(const ResultTable& table, const std::vector<GroupSummary>& groups,
                     const std::string& first, bool corrected) {
  Grid grid;
  grid.title = corrected
                   ? "By goal class (exploratory; p corrected by Holm for the number of rows)"
                   : table.run.title;
  grid.header = {first,      "SR-Before",
                 "SR-After", "Difference [points]",
                 "Pairs",    corrected ? "p (Holm)" : "p"};
  if (!corrected) grid.header.insert(grid.header.end(), {"Verdict"});
  if (!table.oracle.empty()) grid.header.emplace_back("SR-Oracle");
  if (table.before != "before") grid.header[1] = "SR " + table.before;
  if (table.after != "after") grid.header[2] = "SR " + table.after;
  for (const GroupSummary& group : groups) {
    std::vector<std::string> row{group.title + (group.leak ? " *" : ""),
                                 rate_text(group.find(table.before)),
                                 rate_text(group.find(table.after)),
                                 difference_text(group),
                                 pairs_text(group),
                                 p_text(corrected ? group.p_holm : group.p_exact)};
    if (!corrected) row.push_back(group.verdict);
    if (!table.oracle.empty()) row.push_back(rate_text(group.find(table.oracle)));
    grid.rows.push_back(std::move(row));
  }
  return grid;
}

/// For runs without two arms to compare.
Grid rates_grid(const ResultTable& table, const std::vector<GroupSummary>& groups,
                const std::string& first) {
  Grid grid{table.run.title, {first}, {}};
  for (const ArmRow& arm : table.arm_rows) grid.header.push_back("SR " + arm.name);
  for (const GroupSummary& group : groups) {
    std::vector<std::string> row{group.title};
    for (const ArmSummary& arm : group.arms) row.push_back(rate_text(&arm));
    grid.rows.push_back(std::move(row));
  }
  return grid;
}

/// Name of the run's success rule, without its explanation.
std::string profile_name(const ResultTable& table) {
  return table.run.success_profile.substr(0, table.run.success_profile.find(':'));
}

Grid arms_grid(const ResultTable& table, const std::vector<GroupSummary>& groups) {
  Grid grid{"How the trials went (success: " + profile_name(table) + ")",
            {"Scene", "Arm", "SR", "SPL", "SoftSPL", "Time [s]", "Path [m]", "Contacts",
             "Holes [%]", "Outcomes"},
            {}};
  for (const GroupSummary& group : groups) {
    for (const ArmSummary& arm : group.arms) {
      std::string outcomes;
      for (const auto& [outcome, count] : arm.outcomes) {
        outcomes += (outcomes.empty() ? "" : ", ") + outcome + " " + std::to_string(count);
      }
      grid.rows.push_back(
          {group.title, arm.arm, share_text(arm.success.successes, arm.success.trials),
           print("%.3f", arm.spl), print("%.3f", arm.soft_spl), print("%.1f", arm.sim_s),
           print("%.1f", arm.path_m), print("%.2f", arm.contacts),
           print("%.1f", 100.0 * arm.invalid_pixels), outcomes});
    }
  }
  return grid;
}

/// How good the arms' detectors are on held-out views; no rows if that was not measured.
Grid detectors_grid(const ResultTable& table) {
  Grid grid{"Detectors on held-out views of the scenes",
            {"Arm", "AP50", "AP", "Precision", "Recall", "Score threshold", "Views",
             "AP50 source rooms", "AP50 unseen homes"},
            {}};
  const auto optional_text = [](const std::optional<double>& ap50) {
    return ap50 ? print("%.1f", 100.0 * *ap50) : std::string("-");
  };
  for (const ArmRow& arm : table.arm_rows) {
    if (!arm.held_out) continue;
    const HeldOutPrecision& p = *arm.held_out;
    grid.rows.push_back({arm.name, print("%.1f", 100.0 * p.ap50), print("%.1f", 100.0 * p.ap),
                         print("%.2f", p.precision), print("%.2f", p.recall),
                         print("%.3f", p.score_threshold), std::to_string(p.views),
                         optional_text(p.source_ap50), optional_text(p.unseen_ap50)});
  }
  return grid;
}

std::vector<Grid> grids_of(const ResultTable& table) {
  std::vector<GroupSummary> rows = table.scenes;
  if (table.all) rows.push_back(*table.all);
  std::vector<Grid> grids;
  if (compares(table)) {
    grids.push_back(comparison_grid(table, rows, "Scene", false));
    grids.push_back(comparison_grid(table, table.classes, "Goal", true));
  } else {
    grids.push_back(rates_grid(table, rows, "Scene"));
    grids.push_back(rates_grid(table, table.classes, "Goal"));
    grids.back().title = "By goal class";
  }
  grids.push_back(arms_grid(table, table.scenes));
  for (Grid& grid : std::vector<Grid>{
           internal::causes_grid(table.scenes), internal::perception_grid(table.scenes),
           internal::profiles_grid(table.scenes), detectors_grid(table)}) {
    if (!grid.rows.empty()) grids.push_back(std::move(grid));
  }
  return grids;
}

std::string pad(const std::string& text, std::size_t width) {
  return text + std::string(width > text.size() ? width - text.size() : 0, ' ');
}

std::vector<std::size_t> widths_of(const Grid& grid) {
  std::vector<std::size_t> widths;
  for (const std::string& cell : grid.header) widths.push_back(cell.size());
  for (const auto& row : grid.rows) {
    for (std::size_t i = 0; i < row.size(); ++i)
      widths[i] = std::max(widths[i], row[i].size());
  }
  return widths;
}

std::string text_line(const std::vector<std::string>& cells,
                      const std::vector<std::size_t>& widths) {
  std::string line;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    line += (i == 0 ? "" : "  ") + pad(cells[i], widths[i]);
  }
  return line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
}

/// Breaks at spaces so that no line is longer than `width`, if it can be done.
std::string wrap(const std::string& text, std::size_t width, const std::string& indent) {
  std::string wrapped, line;
  std::size_t start = 0;
  while (start < text.size()) {
    const std::size_t end = std::min(text.find(' ', start), text.size());
    const std::string word = text.substr(start, end - start);
    if (!line.empty() && line.size() + 1 + word.size() > width) {
      wrapped += line + "\n" + indent;
      line.clear();
    }
    line += (line.empty() ? "" : " ") + word;
    start = end + 1;
  }
  return wrapped + line;
}

std::string as_text(const ResultTable& table) {
  std::string text;
  for (const Grid& grid : grids_of(table)) {
    const std::vector<std::size_t> widths = widths_of(grid);
    text += grid.title + "\n\n" + text_line(grid.header, widths);
    std::vector<std::string> rules;
    for (const std::size_t width : widths) rules.emplace_back(width, '-');
    text += text_line(rules, widths);
    for (const auto& row : grid.rows) text += text_line(row, widths);
    text += "\n";
  }
  for (const std::string& note : table.notes) text += "- " + wrap(note, 98, "  ") + "\n";
  return text;
}

std::string markdown_line(const std::vector<std::string>& cells) {
  std::string line = "|";
  for (const std::string& cell : cells) line += " " + cell + " |";
  return line + "\n";
}

std::string as_markdown(const ResultTable& table) {
  std::string text;
  for (const Grid& grid : grids_of(table)) {
    text +=
        (text.empty() ? "# " : "## ") + grid.title + "\n\n" + markdown_line(grid.header) + "|";
    for (std::size_t i = 0; i < grid.header.size(); ++i) text += "---|";
    text += "\n";
    for (std::vector<std::string> row : grid.rows) {
      for (std::string& cell : row) {  // The asterisk of leakage is not emphasis.
        const std::size_t star = cell.rfind(" *");
        if (star != std::string::npos && star + 2 == cell.size()) cell.insert(star + 1, "\\");
      }
      text += markdown_line(row);
    }
    text += "\n";
  }
  for (const std::string& note : table.notes) text += "- " + note + "\n";
  return text;
}

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
      "difference,difference_low,difference_high,p_exact,p_mid,p_holm,p_spl,verdict\n";
  const auto add = [&](const char* kind, const GroupSummary& group) {
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
                                   group.p_holm, group.p_spl}) {
          text += "," + print("%.6g", value);
        }
        text += "," + group.verdict + "\n";
      } else {
        text += ",,,,,,,,,,,\n";
      }
    }
  };
  for (const GroupSummary& group : table.scenes) add("scene", group);
  if (table.all) add("all", *table.all);
  for (const GroupSummary& group : table.classes) add("class", group);
  return text;
}

}  // namespace

std::string format_table(const ResultTable& table, TableFormat format) {
  switch (format) {
    case TableFormat::kText:
      return as_text(table);
    case TableFormat::kMarkdown:
      return as_markdown(table);
    case TableFormat::kCsv:
      return as_csv(table);
    case TableFormat::kJson:
      return internal::as_json(table);
  }
  return {};
}

}  // namespace segsim::experiments
