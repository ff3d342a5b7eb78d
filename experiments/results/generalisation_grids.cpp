#include "experiments/results/generalisation_grids.h"

#include <algorithm>

#include "core/formatted.h"
#include "experiments/results/insight_grids.h"
#include "experiments/results/leakage.h"
#include "experiments/results/table_grids.h"
#include "experiments/results/training_grids.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::results::internal {
namespace {

using support::internal::Grid;

std::string points_text(const std::optional<MeanInterval>& difference) {
  if (!difference) return "-";
  return core::print("%+.1f", 100.0 * difference->mean) + " [" +
         core::print("%+.1f", 100.0 * difference->interval.low) + ", " +
         core::print("%+.1f", 100.0 * difference->interval.high) + "]";
}

std::string strict_text(const ArmSummary& arm) {
  const ProfileRate* rate = arm.insights.by_rule(kStrictestRule);
  return rate == nullptr ? "-" : share_text(rate->successes, arm.insights.trials);
}

}  // namespace

Grid leaderboard_grid(const ResultTable& table) {
  Grid grid{table.run.title,
            {"Arm", "SR", std::string("SR ") + kStrictestRule, "SPL", "SoftSPL", "Trainings",
             "Leakage"},
            {}};
  if (table.scenes.empty()) return grid;
  grid.lines = {
      std::to_string(table.scenes.size()) + (table.scenes.size() == 1 ? " scene" : " scenes") +
      ". Success rule: " + profile_name(table) + "; beside it the strictest named one."};
  std::vector<ArmSummary> arms = headline_group(table).arms;
  std::stable_sort(arms.begin(), arms.end(), [](const ArmSummary& a, const ArmSummary& b) {
    return a.success.value() > b.success.value();
  });
  for (const ArmSummary& arm : arms) {
    grid.rows.push_back({arm.arm, rate_text(&arm), strict_text(arm),
                         core::print("%.3f", arm.spl), core::print("%.3f", arm.soft_spl),
                         std::to_string(arm.members), leakage_word(table, arm.arm, "")});
  }
  return grid;
}

Grid generalisation_grid(const ResultTable& table) {
  Grid grid{"Does it carry over? (every arm against \"" + table.before + "\")",
            {"Scenes", "Arm", "SR", "Difference [points]", "Trainings", "Leakage"},
            {}};
  bool few = false;
  for (const Generalisation& row : table.generalisation) {
    few |= row.scenes < kScenesForClaim;
    grid.rows.push_back({row.group, row.arm, rate_text(&row.summary),
                         points_text(row.difference), std::to_string(row.summary.members),
                         row.leakage});
  }
  grid.lines.emplace_back(
      "Difference: on the same episodes, with a 95 % interval in which scenes are drawn, too: "
      "of one training a cluster bootstrap over scenes, of several the hierarchical interval. "
      "Leakage: whether the weights that decide in a scene had seen views of that scene.");
  if (few) {
    grid.lines.emplace_back(
        "Rows of fewer than 5 scenes: their interval says nothing of other scenes.");
  }
  return grid;
}

Grid mixed_grid(const ResultTable& table) {
  std::vector<GroupSummary> groups = table.scenes;
  groups.insert(groups.end(), table.pools.begin(), table.pools.end());
  if (table.all) groups.push_back(*table.all);
  Grid grid = rates_grid(table, groups, "Scene");
  grid.title = "By scene, all arms (*: tuned on views of that scene)";
  for (std::size_t row = 0; row < table.scenes.size(); ++row) {
    const GroupSummary& scene = table.scenes[row];
    for (std::size_t arm = 0; arm < scene.arms.size(); ++arm) {
      const std::string word = leakage_word(table, scene.arms[arm].arm, scene.name);
      if (word == "scene") grid.rows[row][arm + 1] += " *";
    }
  }
  return grid;
}

}  // namespace segsim::experiments::results::internal
