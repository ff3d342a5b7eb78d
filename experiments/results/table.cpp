#include "experiments/results/table.h"

#include <algorithm>
#include <cstddef>
#include <set>
#include <utility>

#include "core/config.h"
#include "core/error.h"
#include "experiments/results/internal/group_summary.h"
#include "experiments/results/leakage.h"
#include "experiments/results/table_notes.h"

namespace segsim::experiments::results {

const ArmSummary* GroupSummary::find(const std::string& arm) const {
  for (const ArmSummary& summary : arms) {
    if (summary.arm == arm) return &summary;
  }
  return nullptr;
}

namespace {

/// Difference of the success rates, with an interval from drawing scenes: of one training.
MeanInterval drawn_scenes(const std::vector<GroupSummary>& scenes) {
  std::vector<ClusterSum> differences;
  differences.reserve(scenes.size());
  for (const GroupSummary& scene : scenes) {
    differences.push_back(
        {static_cast<double>(scene.pairs.only_after - scene.pairs.only_before),
         scene.pairs.total()});
  }
  return cluster_bootstrap_mean(differences);
}

/// All scenes, or some of them, as one row.
GroupSummary summarise_scenes(const internal::TableInputs& inputs, const ResultTable& table,
                              const std::string& name, const std::string& title,
                              const std::vector<std::size_t>& members) {
  const auto has = [&](std::size_t scene) {
    return std::find(members.begin(), members.end(), scene) != members.end();
  };
  GroupSummary group = internal::summarise_group(
      inputs, name, title, [&](const internal::Episode& e) { return has(e.scene); });
  for (const std::size_t scene : members) group.scenes.push_back(table.scenes[scene].name);
  if (inputs.pairs.size() != 1) return group;
  std::vector<GroupSummary> scenes;
  scenes.reserve(members.size());
  for (const std::size_t scene : members) {
    scenes.push_back(internal::summarise_group(
        inputs, "", "", [scene](const internal::Episode& e) { return e.scene == scene; }));
  }
  group.over_scenes = drawn_scenes(scenes);
  return group;
}

/// Scenes of each pool of the spec, by place in table.scenes; in the order of the scenes.
std::vector<std::pair<std::string, std::vector<std::size_t>>> pools_of(
    const ResultTable& table) {
  std::vector<std::pair<std::string, std::vector<std::size_t>>> pools;
  for (std::size_t k = 0; k < table.scenes.size(); ++k) {
    const auto named = table.run.provenance.find("pool/" + table.scenes[k].name);
    if (named == table.run.provenance.end()) continue;
    auto pool = std::find_if(pools.begin(), pools.end(),
                             [&](const auto& known) { return known.first == named->second; });
    if (pool == pools.end()) pool = pools.insert(pools.end(), {named->second, {}});
    pool->second.push_back(k);
  }
  return pools;
}

/// Whether some arm has weights of its own in every scene.
bool has_arms_by_scene(const records::RunRow& run) {
  return std::any_of(run.provenance.begin(), run.provenance.end(),
                     [](const auto& row) { return row.first.starts_with("weights/"); });
}

std::string title_of_pool(const std::string& name, std::size_t scenes) {
  return "Pool " + name + " (" + std::to_string(scenes) +
         (scenes == 1 ? " scene)" : " scenes)");
}

/// Every arm but the oracle against "before", in one group of scenes.
void add_generalisation(internal::TableInputs& inputs, const GroupSummary& group,
                        const std::vector<std::size_t>& members, ResultTable& table) {
  const internal::Family* before = internal::find_family(inputs.families, table.before);
  const std::vector<internal::RowPair> compared = inputs.pairs;
  for (const internal::Family& family : inputs.families) {
    if (table.arm_rows[family.rows.front()].detector == "oracle") continue;
    Generalisation row{group.title, family.name, members.size(), *group.find(family.name),
                       internal::leakage_word(table, family.name, group.scenes)};
    if (before != nullptr && family.name != before->name) {
      inputs.pairs = internal::paired_rows(table.arm_rows, *before, family);
      const GroupSummary against =
          summarise_scenes(inputs, table, group.name, group.title, members);
      row.difference = against.over_scenes ? *against.over_scenes
                                           : MeanInterval{against.difference.difference,
                                                          against.difference.interval};
    }
    table.generalisation.push_back(std::move(row));
  }
  inputs.pairs = compared;
}

/// Rows of pools, and of all arms over them and over all scenes.
void add_pools(internal::TableInputs& inputs, ResultTable& table) {
  const auto pools = pools_of(table);
  if (pools.empty() && !has_arms_by_scene(table.run)) return;
  for (const auto& [name, members] : pools) {
    const std::string title = title_of_pool(name, members.size());
    GroupSummary group = summarise_scenes(inputs, table, "pool " + name, title, members);
    add_generalisation(inputs, group, members, table);
    if (pools.size() > 1) table.pools.push_back(std::move(group));
  }
  const bool whole = pools.size() == 1 && pools.front().second.size() == table.scenes.size();
  if (whole || table.scenes.empty()) return;
  std::vector<std::size_t> members;
  for (std::size_t k = 0; k < table.scenes.size(); ++k) members.push_back(k);
  GroupSummary group = table.all ? *table.all : table.scenes.front();
  for (const GroupSummary& scene : table.scenes) group.scenes.push_back(scene.name);
  add_generalisation(inputs, group, members, table);
}

}  // namespace

ResultTable summarise(const records::RunRow& run, const std::vector<records::SceneRow>& scenes,
                      const std::vector<records::ArmRow>& arms,
                      const std::vector<records::TrialRow>& trials, const std::string& before,
                      const std::string& after) {
  ResultTable table;
  table.run = run;
  table.scene_rows = scenes;
  table.arm_rows = arms;
  internal::TableInputs inputs{table.arm_rows,
                               internal::SortedTrials(trials, scenes, arms),
                               internal::arm_families(arms),
                               {}};
  internal::choose_arms(before, after, inputs.families, table);
  if (!table.before.empty() && !table.after.empty()) {
    inputs.pairs =
        internal::paired_rows(arms, *internal::find_family(inputs.families, table.before),
                              *internal::find_family(inputs.families, table.after));
  }
  table.trainings = internal::summarise_trainings(inputs);
  table.compares_trainings = internal::compares_weights(arms, inputs.pairs);
  for (const records::TrialRow& trial : trials)
    table.finished_trials += trial.failed() ? 0 : 1;

  const std::vector<const records::SceneRow*> families = internal::scene_families(scenes);
  for (std::size_t k = 0; k < families.size(); ++k) {
    const records::SceneRow& scene = *families[k];
    GroupSummary group =
        internal::summarise_group(inputs, records::family_of(scene), scene.title,
                                  [&](const internal::Episode& e) { return e.scene == k; });
    group.leak = internal::is_tuned_on(table, records::family_of(scene));
    table.scenes.push_back(std::move(group));
  }
  if (families.size() > 1) {
    table.all = internal::summarise_group(inputs, "all", "All scenes",
                                          [](const internal::Episode&) { return true; });
    if (inputs.pairs.size() == 1) table.all->over_scenes = drawn_scenes(table.scenes);
  }
  add_pools(inputs, table);

  std::set<std::string> class_names;
  for (const records::TrialRow& trial : trials) class_names.insert(trial.goal_class);
  std::vector<double> p_values;
  for (const std::string& name : class_names) {
    table.classes.push_back(internal::summarise_group(
        inputs, name, name,
        [&](const internal::Episode& e) { return e.first->goal_class == name; }));
    p_values.push_back(table.classes.back().p);
  }
  const std::vector<double> corrected = holm_correction(p_values);
  for (std::size_t i = 0; i < corrected.size(); ++i) table.classes[i].p_holm = corrected[i];

  internal::add_notes(table, trials);
  return table;
}

support::TableFormat table_format_from(const std::string& word) {
  const std::vector<std::string> words{"text", "md", "csv", "json", "tex"};
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (word == words[i]) return static_cast<support::TableFormat>(i);
  }
  const std::string near = core::nearest_word(word, words);
  throw core::InputError::expected(
      "--format", "text | md | tex | csv | json",
      "\"" + word + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
}

}  // namespace segsim::experiments::results
