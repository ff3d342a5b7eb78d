#include "experiments/results/table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>

#include "core/config.h"
#include "core/error.h"
#include "experiments/results/internal/table_notes.h"

namespace segsim::experiments {
namespace {

using internal::find_arm;

/// Trials of one episode, by arm.
using EpisodeTrials = std::map<std::string, std::vector<const TrialRow*>>;

/// What one arm made of one episode; nothing if no usable trial exists.
struct EpisodeResult {
  bool success = false;
  double spl = 0.0, soft_spl = 0.0, sim_s = 0.0, path_m = 0.0;
};

std::optional<EpisodeResult> result_of(const EpisodeTrials& episode, const std::string& arm) {
  const auto found = episode.find(arm);
  if (found == episode.end()) return std::nullopt;
  EpisodeResult result;
  int usable = 0, successes = 0;
  for (const TrialRow* trial : found->second) {
    if (!trial->counts()) continue;
    ++usable;
    successes += trial->success ? 1 : 0;
    result.spl += trial->spl;
    result.soft_spl += trial->soft_spl;
    result.sim_s += trial->sim_s;
    result.path_m += trial->path_m;
  }
  if (usable == 0) return std::nullopt;
  result.success = 2 * successes > usable;
  result.spl /= usable;
  result.soft_spl /= usable;
  result.sim_s /= usable;
  result.path_m /= usable;
  return result;
}

ArmSummary summarise_arm(const std::string& arm,
                         const std::map<std::string, EpisodeTrials>& episodes) {
  ArmSummary summary;
  summary.arm = arm;
  std::map<std::string, int> outcomes;
  std::vector<const TrialRow*> all;
  int usable = 0;
  for (const auto& [id, episode] : episodes) {
    if (const auto result = result_of(episode, arm)) {
      ++summary.success.trials;
      summary.success.successes += result->success ? 1 : 0;
      summary.spl += result->spl;
      summary.soft_spl += result->soft_spl;
    }
    const auto found = episode.find(arm);
    if (found == episode.end()) continue;
    for (const TrialRow* trial : found->second) {
      ++summary.trials;
      ++outcomes[trial->outcome];
      all.push_back(trial);
      if (!trial->counts()) {
        ++(trial->failed() ? summary.failed_trials : summary.excluded_trials);
        continue;
      }
      ++usable;
      summary.sim_s += trial->sim_s;
      summary.path_m += trial->path_m;
      summary.contacts += trial->contacts;
      summary.invalid_pixels += trial->invalid_pixel_fraction;
    }
  }
  summary.insights = gain_insights(all);
  const double n = std::max(1, summary.success.trials), m = std::max(1, usable);
  summary.spl /= n;
  summary.soft_spl /= n;
  summary.sim_s /= m;
  summary.path_m /= m;
  summary.contacts /= m;
  summary.invalid_pixels /= m;
  summary.outcomes.assign(outcomes.begin(), outcomes.end());
  std::stable_sort(summary.outcomes.begin(), summary.outcomes.end(),
                   [](const auto& x, const auto& y) { return x.second > y.second; });
  return summary;
}

/// Counts the pairs of one group and tests them.
void compare(const std::map<std::string, EpisodeTrials>& episodes, const std::string& before,
             const std::string& after, GroupSummary& group) {
  std::vector<double> spl, sim_s, path_m;
  for (const auto& [id, episode] : episodes) {
    const auto first = result_of(episode, before), second = result_of(episode, after);
    if (!first || !second) {
      ++group.dropped_pairs;
      continue;
    }
    int& count = first->success
                     ? (second->success ? group.pairs.both : group.pairs.only_before)
                     : (second->success ? group.pairs.only_after : group.pairs.neither);
    ++count;
    spl.push_back(second->spl - first->spl);
    sim_s.push_back(second->sim_s - first->sim_s);
    path_m.push_back(second->path_m - first->path_m);
  }
  group.p_exact = mcnemar_exact_p(group.pairs.only_after, group.pairs.only_before);
  group.p_mid = mcnemar_mid_p(group.pairs.only_after, group.pairs.only_before);
  group.p_holm = group.p_exact;
  const auto paired = [](const std::vector<double>& differences) {
    return PairedMean{bootstrap_mean(differences), sign_flip_p(differences)};
  };
  group.spl = paired(spl);
  group.sim_s = paired(sim_s);
  group.path_m = paired(path_m);
  group.difference = newcombe_paired_difference(group.pairs);
  group.verdict = verdict(group.pairs);
}

GroupSummary summarise_group(const ResultTable& table, const std::string& name,
                             const std::string& title, const std::vector<TrialRow>& trials,
                             const std::function<bool(const TrialRow&)>& belongs) {
  GroupSummary group;
  group.name = name;
  group.title = title;
  std::map<std::string, EpisodeTrials> episodes;  // Ordered, so sums have a fixed order.
  for (const TrialRow& trial : trials) {
    if (belongs(trial)) episodes[trial.episode][trial.arm].push_back(&trial);
  }
  for (const ArmRow& arm : table.arm_rows) {
    group.arms.push_back(summarise_arm(arm.name, episodes));
  }
  if (!table.before.empty() && !table.after.empty()) {
    compare(episodes, table.before, table.after, group);
  }
  return group;
}

std::string required_arm(const std::vector<ArmRow>& arms, const std::string& name) {
  if (find_arm(arms, name) != nullptr) return name;
  std::string names;
  for (const ArmRow& arm : arms) names += (names.empty() ? "" : ", ") + arm.name;
  throw core::InputError::expected("arm", "one of " + names, "\"" + name + "\"");
}

/// Fills in table.before, .after and .oracle.
void choose_arms(const std::string& before, const std::string& after, ResultTable& table) {
  std::vector<std::string> candidates;
  for (const ArmRow& arm : table.arm_rows) {
    if (arm.detector == "oracle") {
      if (table.oracle.empty()) table.oracle = arm.name;
    } else {
      candidates.push_back(arm.name);
    }
  }
  const bool named = find_arm(table.arm_rows, "before") != nullptr &&
                     find_arm(table.arm_rows, "after") != nullptr;
  if (named) {
    table.before = "before";
    table.after = "after";
  } else if (candidates.size() >= 2) {
    table.before = candidates[0];
    table.after = candidates[1];
  }
  if (!before.empty()) table.before = required_arm(table.arm_rows, before);
  if (!after.empty()) table.after = required_arm(table.arm_rows, after);
}

bool lists(const std::string& comma_separated, const std::string& name) {
  std::size_t start = 0;
  while (start <= comma_separated.size()) {
    const std::size_t end =
        std::min(comma_separated.find(", ", start), comma_separated.size());
    if (comma_separated.substr(start, end - start) == name) return true;
    start = end + 2;
  }
  return false;
}

}  // namespace

const ArmSummary* GroupSummary::find(const std::string& arm) const {
  for (const ArmSummary& summary : arms) {
    if (summary.arm == arm) return &summary;
  }
  return nullptr;
}

ResultTable summarise(const RunRow& run, const std::vector<SceneRow>& scenes,
                      const std::vector<ArmRow>& arms, const std::vector<TrialRow>& trials,
                      const std::string& before, const std::string& after) {
  ResultTable table;
  table.run = run;
  table.scene_rows = scenes;
  table.arm_rows = arms;
  choose_arms(before, after, table);
  for (const TrialRow& trial : trials) table.finished_trials += trial.failed() ? 0 : 1;

  const ArmRow* after_arm = find_arm(arms, table.after);
  for (const SceneRow& scene : scenes) {
    GroupSummary group =
        summarise_group(table, scene.name, scene.title, trials,
                        [&](const TrialRow& t) { return t.scene == scene.name; });
    group.leak = after_arm != nullptr && lists(after_arm->tuned_on, scene.name);
    table.scenes.push_back(std::move(group));
  }
  if (scenes.size() > 1) {
    table.all = summarise_group(table, "all", "All scenes", trials,
                                [](const TrialRow&) { return true; });
    std::vector<ClusterSum> differences;
    for (const GroupSummary& scene : table.scenes) {
      differences.push_back(
          {static_cast<double>(scene.pairs.only_after - scene.pairs.only_before),
           scene.pairs.total()});
    }
    table.all->over_scenes = cluster_bootstrap_mean(differences);
  }

  std::vector<std::string> class_names;
  for (const TrialRow& trial : trials) class_names.push_back(trial.goal_class);
  std::sort(class_names.begin(), class_names.end());
  class_names.erase(std::unique(class_names.begin(), class_names.end()), class_names.end());
  std::vector<double> p_values;
  for (const std::string& name : class_names) {
    table.classes.push_back(summarise_group(
        table, name, name, trials, [&](const TrialRow& t) { return t.goal_class == name; }));
    p_values.push_back(table.classes.back().p_exact);
  }
  const std::vector<double> corrected = holm_correction(p_values);
  for (std::size_t i = 0; i < corrected.size(); ++i) table.classes[i].p_holm = corrected[i];

  internal::add_notes(table, trials);
  return table;
}

TableFormat table_format_from(const std::string& word) {
  const std::vector<std::string> words{"text", "md", "csv", "json", "tex"};
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (word == words[i]) return static_cast<TableFormat>(i);
  }
  const std::string near = core::nearest_word(word, words);
  throw core::InputError::expected(
      "--format", "text | md | tex | csv | json",
      "\"" + word + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
}

}  // namespace segsim::experiments
