#include "experiments/results/navigation_table.h"

#include <algorithm>
#include <array>

#include <nlohmann/json.hpp>

#include "core/check.h"
#include "core/formatted.h"
#include "experiments/results/leakage.h"
#include "experiments/results/table_grids.h"
#include "experiments/results/training_grids.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::results {
namespace {

using core::print;
using support::internal::Grid;
using Json = nlohmann::ordered_json;

constexpr const char* kTitle = "Impact of fine-tuning on object search (the paper's Table 3)";
constexpr const char* kNotGiven = "not given";

/// One line of the table: a scene of a run, or a run that is not there.
struct Row {
  const NavigationEntry* entry = nullptr;
  const GroupSummary* scene = nullptr;
  const PaperNavigationRow* paper = nullptr;
};

std::vector<Row> rows_of(std::span<const NavigationEntry> entries) {
  std::vector<Row> rows;
  for (const NavigationEntry& entry : entries) {
    const PaperNavigationRow* paper = nullptr;
    for (const PaperNavigationRow& row : paper_table3()) {
      if (entry.paper_scene == row.scene) paper = &row;
    }
    SEGSIM_CHECK(paper != nullptr || entry.paper_scene.empty(), entry.paper_scene);
    if (!entry.result) {
      rows.push_back({&entry, nullptr, paper});
      continue;
    }
    for (const GroupSummary& scene : entry.result->scenes) {
      rows.push_back({&entry, &scene, paper});
    }
  }
  return rows;
}

Grid grid_of(const std::vector<Row>& rows) {
  Grid grid{kTitle,
            {"Paper's scene", "Paper SR-Before", "Paper SR-After", "Paper n", "Scene here",
             "Episodes", "SR-Before", "SR-After", "Difference [points]", "Pairs", "p",
             "Verdict", "SR-Oracle", "Leakage"},
            {}};
  for (const Row& row : rows) {
    std::vector<std::string> cells{"-", "-", "-", "-"};
    if (row.paper != nullptr) {
      cells = {row.paper->scene, print("%.0f %%", row.paper->before_percent),
               print("%.0f %%", row.paper->after_percent), kNotGiven};
    }
    if (row.scene == nullptr) {
      cells.insert(cells.end(), {row.entry->title, "not run"});
      cells.resize(grid.header.size(), "-");
    } else {
      const ResultTable& table = *row.entry->result;
      const GroupSummary& scene = *row.scene;
      const ArmSummary* before = scene.find(table.before);
      cells.insert(
          cells.end(),
          {scene.title, std::to_string(before == nullptr ? 0 : before->success.trials),
           internal::rate_text(before), internal::rate_text(scene.find(table.after)),
           internal::difference_text(scene), internal::pairs_text(scene),
           internal::p_text(scene.p), scene.verdict,
           internal::rate_text(scene.find(table.oracle)),
           internal::compared_leakage_word(table, scene.name)});
    }
    grid.rows.push_back(std::move(cells));
  }
  return grid;
}

std::string strict_text(const ArmSummary* arm) {
  const ProfileRate* rate =
      arm == nullptr ? nullptr : arm->insights.by_rule(internal::kStrictestRule);
  if (rate == nullptr) return "-";
  const int trials = arm->insights.trials;
  return print("%d/%d", rate->successes, trials) +
         print("  %.0f %%", 100.0 * rate->successes / trials);
}

/// The run's own rule of success beside the strictest named one, and the arms that bound it.
Grid rules_grid(const std::vector<Row>& rows) {
  Grid grid{"The same trials by two rules of success",
            {"Scene here", "Rule", "Before", "After", "Oracle", "Random policy"},
            {}};
  for (const Row& row : rows) {
    if (row.scene == nullptr) continue;
    const ResultTable& table = *row.entry->result;
    const auto add = [&](const std::string& rule, auto&& text_of) {
      std::vector<std::string> cells{row.scene->title, rule};
      for (const std::string& arm :
           {table.before, table.after, table.oracle, std::string("random")}) {
        cells.push_back(text_of(row.scene->find(arm)));
      }
      grid.rows.push_back(std::move(cells));
    };
    add(internal::profile_name(table), internal::rate_text);
    if (internal::profile_name(table) == internal::kStrictestRule) continue;
    add(internal::kStrictestRule, strict_text);
  }
  return grid;
}

std::vector<std::string> notes_of(std::span<const NavigationEntry> entries) {
  std::vector<std::string> notes{
      "Paper: Fast-SegSim, arXiv 2604.10951, table \"Impact of finetuning\". It gives success "
      "rates alone: no number of episodes, rule of success, start poses, seeds, or which "
      "scenes "
      "were in both tuning and test. With n = 5 its laboratory row would have p = 0.125, with "
      "n = 10 p = 0.008; its house row has p > 0.05 for every n up to 20, even if no episode "
      "got worse.",
      "Other scenes, robot and detector than the paper's: rows stand side by side to be read, "
      "not to be compared digit by digit."};
  for (const NavigationEntry& entry : entries) {
    if (!entry.result) {
      notes.push_back("Not run: " + entry.title + ": " + entry.missing + ".");
      continue;
    }
    for (const std::string& note : entry.result->notes) {
      if (note.starts_with("The paper reports")) continue;  // Said above.
      const std::string line = entry.result->run.name + ": " + note;
      if (std::find(notes.begin(), notes.end(), line) == notes.end()) notes.push_back(line);
    }
  }
  return notes;
}

Json json_rate(const ArmSummary* arm) {
  if (arm == nullptr) return nullptr;
  const Interval interval = arm->interval();
  Json json{
      {"arm", arm->arm},
      {"trainings", arm->members},
      {"successes", arm->success.successes},
      {"episodes", arm->success.trials},
      {"sr", arm->success.value()},
      {arm->pooled_interval ? "hierarchical95" : "wilson95", {interval.low, interval.high}}};
  if (!arm->pooled_interval) {
    const Interval exact = clopper_pearson_interval(arm->success);
    json["clopper_pearson95"] = {exact.low, exact.high};
  }
  return json;
}

std::string json_text(std::span<const NavigationEntry> entries) {
  Json json{{"schema", "segsim.table3/1"}, {"title", kTitle}, {"rows", Json::array()}};
  for (const Row& row : rows_of(entries)) {
    Json line;
    if (row.paper != nullptr) {
      line["paper"] = {{"scene", row.paper->scene},
                       {"sr_before", row.paper->before_percent / 100.0},
                       {"sr_after", row.paper->after_percent / 100.0},
                       {"episodes", nullptr}};
    }
    if (row.scene == nullptr) {
      line["scene"] = row.entry->title;
      line["missing"] = row.entry->missing;
    } else {
      const ResultTable& table = *row.entry->result;
      const GroupSummary& scene = *row.scene;
      line["scene"] = scene.title;
      line["run"] = {{"name", table.run.name},
                     {"id", table.run.run_id},
                     {"spec_sha256", table.run.spec_sha256},
                     {"code_version", table.run.code_version},
                     {"seed", table.run.seed},
                     {"success_profile", table.run.success_profile}};
      line["before"] = json_rate(scene.find(table.before));
      line["after"] = json_rate(scene.find(table.after));
      line["oracle"] = json_rate(scene.find(table.oracle));
      line["only_after"] = scene.pairs.only_after;
      line["only_before"] = scene.pairs.only_before;
      line["pairs"] = scene.pairs.total();
      line["difference"] = scene.difference.difference;
      line[scene.training ? "hierarchical95" : "newcombe95"] = {
          scene.difference.interval.low, scene.difference.interval.high};
      line[scene.training ? "p_trainings" : "p_mcnemar_exact"] = scene.p;
      if (!scene.training) line["p_mcnemar_mid"] = scene.p_mid;
      line["verdict"] = scene.verdict;
      line["leakage"] = internal::compared_leakage_word(table, scene.name);
    }
    json["rows"].push_back(std::move(line));
  }
  json["notes"] = notes_of(entries);
  return json.dump(2) + "\n";
}

}  // namespace

std::span<const PaperNavigationRow> paper_table3() {
  static constexpr std::array<PaperNavigationRow, 2> kRows{
      {{"Laboratory Room", 20, 100}, {"House", 25, 50}}};
  return kRows;
}

std::string format_navigation_table(std::span<const NavigationEntry> entries,
                                    support::TableFormat format) {
  if (format == support::TableFormat::kJson) return json_text(entries);
  const std::vector<Row> rows = rows_of(entries);
  const Grid grid = grid_of(rows);
  if (format == support::TableFormat::kCsv)
    return support::internal::csv_of({grid.header, grid.rows});
  return support::internal::document_text({"", {grid, rules_grid(rows)}, notes_of(entries)},
                                          format);
}

}  // namespace segsim::experiments::results
