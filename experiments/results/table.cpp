#include "experiments/results/table.h"

#include <cstddef>
#include <set>

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
    if (inputs.pairs.size() == 1) {
      std::vector<ClusterSum> differences;
      for (const GroupSummary& scene : table.scenes) {
        differences.push_back(
            {static_cast<double>(scene.pairs.only_after - scene.pairs.only_before),
             scene.pairs.total()});
      }
      table.all->over_scenes = cluster_bootstrap_mean(differences);
    }
  }

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
