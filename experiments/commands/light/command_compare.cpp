// `segsim compare` and `segsim plan`.
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/formatted.h"
#include "experiments/commands/light/light_commands.h"
#include "experiments/records/row_words.h"
#include "experiments/results/stored_run.h"
#include "experiments/results/table_grids.h"
#include "experiments/results/training_grids.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::commands::light {
namespace {

using support::internal::Grid;
using Json = nlohmann::ordered_json;

struct CompareFlags {
  std::filesystem::path work;
  std::string before, after, format = "text";
  std::int64_t run_id = 0;
};

std::string outcome_words(const records::TrialRow& trial) {
  const std::string outcome = to_string(trial.outcome);
  const std::string cause = records::word_of(trial.why.cause);
  const bool told = !trial.success && !cause.empty() && cause != outcome;
  return outcome + (told ? " (" + cause + ")" : "") + " #" + std::to_string(trial.trial_id);
}

/// Adds the trials of one training that went otherwise, by episode and repetition.
void add_changed(const results::StoredRun& stored, const results::TrainingSummary& training,
                 bool several, Grid& grid) {
  std::map<std::string, const records::TrialRow*> first;
  const auto key = [](const records::TrialRow& trial) {
    return trial.episode + "\n" + std::to_string(trial.repetition);
  };
  for (const records::TrialRow& trial : stored.trials) {
    if (trial.arm == training.before && trial.counts()) first[key(trial)] = &trial;
  }
  for (const records::TrialRow& trial : stored.trials) {
    if (trial.arm != training.arm || !trial.counts()) continue;
    const auto found = first.find(key(trial));
    if (found == first.end() || found->second->success == trial.success) continue;
    grid.rows.push_back({trial.episode, trial.goal_class, trial.success ? "gained" : "lost",
                         outcome_words(*found->second), outcome_words(trial)});
    if (several) grid.rows.back().push_back(training.arm);
  }
}

/// Trials that went otherwise in the second arm, training by training.
Grid changed_grid(const results::StoredRun& stored, const results::ResultTable& table) {
  Grid grid{"Episodes that changed (#: number for segsim explain)",
            {"Episode", "Goal", "Change", table.before, table.after},
            {}};
  const bool several = table.trainings.size() > 1;
  if (several) grid.header.emplace_back("Training");
  for (const results::TrainingSummary& training : table.trainings) {
    add_changed(stored, training, several, grid);
  }
  return grid;
}

void compare(const CompareFlags& flags) {
  const support::TableFormat format = results::table_format_from(flags.format);
  const results::StoredRun stored = results::load_run(flags.work, flags.run_id);
  const results::ResultTable table = results::summarise(stored, flags.before, flags.after);
  if (!results::internal::compares(table)) {
    throw core::InputError::expected(flags.work.string(), "a run of two arms to compare",
                                     std::to_string(stored.arms.size()) + " arms");
  }
  if (table.before == table.after) {
    throw core::InputError::expected("--after", "another arm than --before",
                                     "\"" + table.after + "\"");
  }
  const Grid changed = changed_grid(stored, table);
  if (format == support::TableFormat::kCsv) {
    std::fputs(results::format_table(table, format).c_str(), stdout);
    return;
  }
  if (format == support::TableFormat::kJson) {
    Json json = Json::parse(results::format_table(table, format));
    json["changed"] = Json::array();
    for (const std::vector<std::string>& row : changed.rows) {
      json["changed"].push_back({{"episode", row[0]},
                                 {"goal", row[1]},
                                 {"change", row[2]},
                                 {"before", row[3]},
                                 {"after", row[4]}});
      if (row.size() > 5) json["changed"].back()["training"] = row[5];
    }
    std::printf("%s\n", json.dump(2).c_str());
    return;
  }
  std::vector<results::GroupSummary> rows = table.scenes;
  if (table.all) rows.push_back(*table.all);
  support::internal::GridDocument document;
  document.grids = {results::internal::comparison_grid(table, rows, "Scene", false),
                    results::internal::trainings_grid(table),
                    results::internal::comparison_grid(table, table.classes, "Goal", true),
                    results::internal::paired_grid(table, rows), changed};
  if (table.trainings.size() < 2) document.grids.erase(document.grids.begin() + 1);
  document.notes = table.notes;
  std::fputs(support::internal::document_text(document, format).c_str(), stdout);
}

struct PlanFlags {
  double psi = 0.0, delta = 0.0, power = 0.8;
  std::string format = "text";
};

void plan(const PlanFlags& flags) {
  const support::TableFormat format = results::table_format_from(flags.format);
  if (flags.delta == 0.0 || std::abs(flags.delta) > flags.psi) {
    throw core::InputError::expected("--delta", "a difference of at most psi, and not 0",
                                     core::print("%g", flags.delta));
  }
  const int pairs = results::pairs_needed(flags.psi, flags.delta, flags.power);
  if (format == support::TableFormat::kJson) {
    const Json json{{"schema", "segsim.plan/1"}, {"psi", flags.psi}, {"delta", flags.delta},
                    {"power", flags.power},      {"pairs", pairs},   {"trials", 2 * pairs}};
    std::printf("%s\n", json.dump(2).c_str());
    return;
  }
  const Grid grid{
      "Episodes for a paired comparison",
      {"psi", "delta", "power", "episodes", "trials of two arms"},
      {{core::print("%g", flags.psi), core::print("%g", flags.delta),
        core::print("%g", flags.power), std::to_string(pairs), std::to_string(2 * pairs)}}};
  if (format == support::TableFormat::kCsv) {
    std::fputs(support::internal::csv_of({grid.header, grid.rows}).c_str(), stdout);
    return;
  }
  const std::vector<std::string> notes{
      "psi: share of episodes that end differently in the two arms; delta: difference of the "
      "success rates; two-sided McNemar test at the 5 % level (Connor 1987).",
      "Write the number into the spec (planned_n) before the first trial: looking at a run "
      "until it is significant makes 5 % meaningless."};
  std::fputs(support::internal::document_text({"", {grid}, notes}, format).c_str(), stdout);
}

}  // namespace

void add_compare_command(CLI::App& app) {
  auto flags = std::make_shared<CompareFlags>();
  CLI::App* command = add_listed(app, kCommands, "compare");
  command->add_option("run", flags->work, "Work folder of `segsim run`, or a results database")
      ->required();
  command->add_option("--before", flags->before, "Arm to compare from (default: before)");
  command->add_option("--after", flags->after, "Arm to compare with (default: after)");
  command->add_option("--run", flags->run_id, "Number of the run (default: the last)");
  command->add_option("--format", flags->format, "text | md | tex | csv | json")
      ->capture_default_str();
  command->callback([flags] { compare(*flags); });
}

void add_plan_command(CLI::App& app) {
  auto flags = std::make_shared<PlanFlags>();
  CLI::App* command = add_listed(app, kCommands, "plan");
  command->add_option("--psi", flags->psi, "Share of episodes that end differently, (0, 1]")
      ->required()
      ->check(CLI::Range(1e-6, 1.0));
  command
      ->add_option("--delta", flags->delta,
                   "Difference of the success rates worth finding, at most psi")
      ->required()
      ->check(CLI::Range(-1.0, 1.0));
  command->add_option("--power", flags->power, "Chance of finding it")
      ->check(CLI::Range(0.05, 0.9999))
      ->capture_default_str();
  command->add_option("--format", flags->format, "text | md | tex | csv | json")
      ->capture_default_str();
  command->callback([flags] { plan(*flags); });
}

}  // namespace segsim::experiments::commands::light
