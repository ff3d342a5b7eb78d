#include "experiments/results/training_grids.h"

#include <cmath>
#include <set>

#include "core/formatted.h"
#include "experiments/results/table_grids.h"
#include "experiments/results/table_notes.h"
#include "experiments/support/text_grid.h"
#include "sim/trial/success_profile.h"

namespace segsim::experiments::results::internal {
namespace {

std::string percent(double share) { return core::print("%.0f %%", 100.0 * share); }

/// Trials of an arm by a named rule, over all scenes; none if they are not attributed.
Proportion rate_by_rule(const ResultTable& table, const std::string& arm,
                        const std::string& rule) {
  Proportion rate;
  for (const GroupSummary& scene : table.scenes) {
    const ArmSummary* summary = scene.find(arm);
    if (summary == nullptr) continue;
    const ProfileRate* of_scene = summary->insights.by_rule(rule);
    if (of_scene == nullptr) continue;
    rate.successes += of_scene->successes;
    rate.trials += summary->insights.trials;
  }
  return rate;
}

std::string strict_rule_line(const ResultTable& table) {
  const sim::SuccessProfile* strictest = sim::find_success_profile(kStrictestRule);
  if (strictest == nullptr || profile_name(table) == kStrictestRule) return {};
  std::string rates;
  for (const std::string& arm : {table.before, table.after, table.oracle}) {
    const Proportion rate = rate_by_rule(table, arm, kStrictestRule);
    if (rate.trials == 0) continue;
    rates += (rates.empty() ? "" : ", ") + arm + " " + std::to_string(rate.successes) + "/" +
             std::to_string(rate.trials) + " (" + percent(rate.value()) + ")";
  }
  if (rates.empty()) return {};
  return std::string(" By the strictest named rule, ") + kStrictestRule + " (" +
         sim::in_words(*strictest) + "), the same trials give: " + rates + ".";
}

std::string training_line(const ResultTable& table) {
  if (table.trainings.size() <= 1) {
    return "One training: interval and p know nothing of the variance of training; another "
           "seed may give another result.";
  }
  return "SR of \"" + table.after + "\": successes / (episodes x trainings), of " +
         trainings_in_words(table) +
         ". Interval and p count what differs between trainings as well as between episodes.";
}

std::string threshold_text(const records::ArmRow& arm) {
  if (arm.score_threshold >= 0.0) return core::print("%.3f", arm.score_threshold);
  return arm.held_out ? core::print("%.3f", arm.held_out->score_threshold) : "-";
}

std::string spread_line(const ResultTable& table) {
  std::string rates;
  double mean = 0.0;
  for (const TrainingSummary& training : table.trainings) {
    rates += (rates.empty() ? "" : ", ") + percent(training.success.value());
    mean += training.success.value() / static_cast<double>(table.trainings.size());
  }
  std::string line = "SR by training: " + rates + "; mean " + percent(mean) +
                     ", standard deviation " +
                     core::print("%.1f points", 100.0 * training_rate_sd(table.trainings));
  const GroupSummary& group = headline_group(table);
  if (!group.training) return line + ".";
  return line + " (" + core::print("%.1f", 100.0 * group.training->training_sd) +
         " of the differences, without the chance of single trials).";
}

}  // namespace

std::string trainings_in_words(const ResultTable& table) {
  const std::size_t count = table.trainings.size();
  if (count == 0 || (count == 1 && !table.compares_trainings)) return {};
  if (count == 1) return "one training";
  std::set<int> reconstructions;
  for (const TrainingSummary& training : table.trainings) {
    reconstructions.insert(find_arm(table.arm_rows, training.arm)->reconstruction);
  }
  std::string words = std::to_string(count) + " trainings";
  if (reconstructions.size() == 1) return words;
  return words + " in " + std::to_string(reconstructions.size()) + " reconstructions";
}

std::string headline_title(const ResultTable& table) {
  const std::string words = trainings_in_words(table);
  return table.run.title + (words.empty() ? "" : " (" + words + ")");
}

std::vector<std::string> headline_lines(const ResultTable& table) {
  std::vector<std::string> lines;
  if (!trainings_in_words(table).empty()) lines.push_back(training_line(table));
  if (!profile_name(table).empty()) {
    lines.push_back("Success rule: " + profile_name(table) + "." + strict_rule_line(table));
  }
  return lines;
}

const GroupSummary& headline_group(const ResultTable& table) {
  return table.all ? *table.all : table.scenes.front();
}

double training_rate_sd(const std::vector<TrainingSummary>& trainings) {
  if (trainings.size() < 2) return 0.0;
  const auto n = static_cast<double>(trainings.size());
  double mean = 0.0, squares = 0.0;
  for (const TrainingSummary& training : trainings) mean += training.success.value() / n;
  for (const TrainingSummary& training : trainings) {
    squares += (training.success.value() - mean) * (training.success.value() - mean);
  }
  return std::sqrt(squares / (n - 1.0));
}

support::internal::Grid trainings_grid(const ResultTable& table) {
  support::internal::Grid grid{
      "Trainings",
      {"Training", "Seed", "Reconstruction", "Weights", "Score threshold", "AP50 held out",
       "SR", "Difference [points]", "Pairs"},
      {}};
  if (table.trainings.size() < 2) return grid;
  for (const TrainingSummary& training : table.trainings) {
    const records::ArmRow& arm = *find_arm(table.arm_rows, training.arm);
    GroupSummary pairs;
    pairs.pairs = training.pairs;
    pairs.difference = newcombe_paired_difference(training.pairs);
    ArmSummary rate;
    rate.success = training.success;
    grid.rows.push_back({training.arm,
                         arm.finetune_seed ? std::to_string(*arm.finetune_seed) : "-",
                         std::to_string(arm.reconstruction), arm.weights_sha256.substr(0, 12),
                         threshold_text(arm),
                         arm.held_out ? core::print("%.1f", 100.0 * arm.held_out->ap50) : "-",
                         rate_text(&rate), difference_text(pairs), pairs_text(pairs)});
  }
  grid.lines.push_back(spread_line(table));
  return grid;
}

}  // namespace segsim::experiments::results::internal
