#include "experiments/results/table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <set>
#include <span>
#include <tuple>

#include "core/config.h"
#include "core/error.h"
#include "experiments/results/internal/leakage.h"
#include "experiments/results/internal/table_notes.h"

namespace segsim::experiments {
namespace {

using internal::find_arm;

/// What one arm made of one episode; `usable` is 0 if no usable trial exists.
struct EpisodeResult {
  int usable = 0;
  bool success = false;
  double spl = 0.0, soft_spl = 0.0, sim_s = 0.0, path_m = 0.0;
};

EpisodeResult result_of(std::span<const TrialRow* const> trials) {
  EpisodeResult result;
  int successes = 0;
  for (const TrialRow* trial : trials) {
    if (!trial->counts()) continue;
    ++result.usable;
    successes += trial->success ? 1 : 0;
    result.spl += trial->spl;
    result.soft_spl += trial->soft_spl;
    result.sim_s += trial->sim_s;
    result.path_m += trial->path_m;
  }
  if (result.usable == 0) return result;
  result.success = 2 * successes > result.usable;
  result.spl /= result.usable;
  result.soft_spl /= result.usable;
  result.sim_s /= result.usable;
  result.path_m /= result.usable;
  return result;
}

/// Trials of one arm in one episode.
struct EpisodeArm {
  std::span<const TrialRow* const> trials;
  EpisodeResult result;
};

/// The trials of a run, sorted once for all groups: by episode, so that sums have a fixed
/// order, then by arm.
class SortedTrials {
 public:
  using Belongs = std::function<bool(const TrialRow&)>;
  /// One episode of a group, by arm.
  using Episode = std::span<const EpisodeArm>;

  SortedTrials(const std::vector<TrialRow>& trials, const std::vector<ArmRow>& arms)
      : arms_(arms.size()) {
    struct Entry {
      std::size_t arm;
      const TrialRow* trial;
    };
    std::vector<Entry> entries;
    entries.reserve(trials.size());
    for (const TrialRow& trial : trials) {
      std::size_t arm = 0;
      while (arm < arms_ && arms[arm].name != trial.arm) ++arm;
      if (arm < arms_) entries.push_back({arm, &trial});  // Others are in no group.
    }
    const auto of_one_episode = [](const TrialRow& a, const TrialRow& b) {
      return a.episode == b.episode && a.scene == b.scene && a.goal_class == b.goal_class;
    };
    std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
      const auto key = [](const Entry& e) {
        return std::tie(e.trial->episode, e.trial->scene, e.trial->goal_class, e.arm);
      };
      return key(a) < key(b);
    });
    sorted_.reserve(entries.size());
    for (const Entry& entry : entries) sorted_.push_back(entry.trial);
    for (std::size_t begin = 0; begin < entries.size();) {
      const std::size_t first = cells_.size();
      cells_.resize(first + arms_);
      std::size_t end = begin;
      while (end < entries.size() && of_one_episode(*sorted_[begin], *sorted_[end])) {
        const std::size_t from = end;
        while (end < entries.size() && entries[end].arm == entries[from].arm &&
               of_one_episode(*sorted_[begin], *sorted_[end])) {
          ++end;
        }
        EpisodeArm& cell = cells_[first + entries[from].arm];
        cell.trials = std::span(sorted_).subspan(from, end - from);
        cell.result = result_of(cell.trials);
      }
      firsts_.push_back(sorted_[begin]);
      begin = end;
    }
  }

  /// Its episodes of which the trials belong to a group.
  [[nodiscard]] std::vector<Episode> episodes(const Belongs& belongs) const {
    std::vector<Episode> chosen;
    for (std::size_t k = 0; k < firsts_.size(); ++k) {
      if (belongs(*firsts_[k])) chosen.push_back(Episode(cells_).subspan(k * arms_, arms_));
    }
    return chosen;
  }

 private:
  std::size_t arms_;
  std::vector<const TrialRow*> sorted_;
  std::vector<EpisodeArm> cells_;        ///< Episodes x arms.
  std::vector<const TrialRow*> firsts_;  ///< A trial of each episode.
};

using Episodes = std::span<const SortedTrials::Episode>;

ArmSummary summarise_arm(const std::string& name, std::size_t arm, Episodes episodes) {
  ArmSummary summary;
  summary.arm = name;
  std::map<std::string, int> outcomes;
  std::vector<const TrialRow*> all;
  int usable = 0;
  for (const SortedTrials::Episode& episode : episodes) {
    const EpisodeResult& result = episode[arm].result;
    if (result.usable > 0) {
      ++summary.success.trials;
      summary.success.successes += result.success ? 1 : 0;
      summary.spl += result.spl;
      summary.soft_spl += result.soft_spl;
    }
    for (const TrialRow* trial : episode[arm].trials) {
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
void compare(Episodes episodes, std::size_t before, std::size_t after, GroupSummary& group) {
  std::vector<double> spl, sim_s, path_m;
  for (const SortedTrials::Episode& episode : episodes) {
    const EpisodeResult* first = &episode[before].result;
    const EpisodeResult* second = &episode[after].result;
    if (first->usable == 0 || second->usable == 0) {
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
                             const std::string& title, const SortedTrials& trials,
                             const SortedTrials::Belongs& belongs) {
  GroupSummary group;
  group.name = name;
  group.title = title;
  const std::vector<SortedTrials::Episode> episodes = trials.episodes(belongs);
  const auto position = [&](const std::string& arm) {
    const auto found = std::find_if(table.arm_rows.begin(), table.arm_rows.end(),
                                    [&](const ArmRow& row) { return row.name == arm; });
    return static_cast<std::size_t>(found - table.arm_rows.begin());
  };
  for (std::size_t arm = 0; arm < table.arm_rows.size(); ++arm) {
    group.arms.push_back(summarise_arm(table.arm_rows[arm].name, arm, episodes));
  }
  if (!table.before.empty() && !table.after.empty()) {
    compare(episodes, position(table.before), position(table.after), group);
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

  const SortedTrials sorted(trials, arms);
  const ArmRow* after_arm = find_arm(arms, table.after);
  for (const SceneRow& scene : scenes) {
    GroupSummary group =
        summarise_group(table, scene.name, scene.title, sorted,
                        [&](const TrialRow& t) { return t.scene == scene.name; });
    group.leak = after_arm != nullptr && internal::is_tuned_on(*after_arm, scene.name);
    table.scenes.push_back(std::move(group));
  }
  if (scenes.size() > 1) {
    table.all = summarise_group(table, "all", "All scenes", sorted,
                                [](const TrialRow&) { return true; });
    std::vector<ClusterSum> differences;
    for (const GroupSummary& scene : table.scenes) {
      differences.push_back(
          {static_cast<double>(scene.pairs.only_after - scene.pairs.only_before),
           scene.pairs.total()});
    }
    table.all->over_scenes = cluster_bootstrap_mean(differences);
  }

  std::set<std::string> class_names;
  for (const TrialRow& trial : trials) class_names.insert(trial.goal_class);
  std::vector<double> p_values;
  for (const std::string& name : class_names) {
    table.classes.push_back(summarise_group(
        table, name, name, sorted, [&](const TrialRow& t) { return t.goal_class == name; }));
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
