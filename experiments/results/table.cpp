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
#include "experiments/results/leakage.h"
#include "experiments/results/table_notes.h"

namespace segsim::experiments {
namespace {

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

/// One episode of a group.
struct Episode {
  std::size_t scene;                 ///< Index of the scene's family; the last: of no scene.
  const TrialRow* first;             ///< One of its trials.
  std::span<const EpisodeArm> arms;  ///< By row of the run's arms.
};
using Episodes = std::span<const Episode>;

/// Scenes of the spec, in the order of the run.
std::vector<const SceneRow*> scene_families(const std::vector<SceneRow>& scenes) {
  std::vector<const SceneRow*> families;
  for (const SceneRow& scene : scenes) {
    const auto same = [&](const SceneRow* known) {
      return family_of(*known) == family_of(scene);
    };
    if (std::none_of(families.begin(), families.end(), same)) families.push_back(&scene);
  }
  return families;
}

/// The trials of a run, sorted once for all groups: by episode, so that sums have a fixed
/// order, then by arm. Reconstructions of a scene share its episodes.
class SortedTrials {
 public:
  using Belongs = std::function<bool(const Episode&)>;

  SortedTrials(const std::vector<TrialRow>& trials, const std::vector<SceneRow>& scenes,
               const std::vector<ArmRow>& arms)
      : arms_(arms.size()) {
    const std::vector<const SceneRow*> families = scene_families(scenes);
    std::map<std::string, std::size_t> family;
    for (const SceneRow& scene : scenes) {
      std::size_t k = 0;
      while (family_of(*families[k]) != family_of(scene)) ++k;
      family[scene.name] = k;
    }
    std::vector<Entry> entries;
    entries.reserve(trials.size());
    for (const TrialRow& trial : trials) {
      std::size_t arm = 0;
      while (arm < arms_ && arms[arm].name != trial.arm) ++arm;
      if (arm == arms_) continue;  // In no group.
      const auto found = family.find(trial.scene);
      entries.push_back(
          {arm, found == family.end() ? families.size() : found->second, &trial});
    }
    std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
      const auto key = [](const Entry& e) {
        return std::tie(e.trial->episode, e.scene, e.trial->goal_class, e.arm);
      };
      return key(a) < key(b);
    });
    sorted_.reserve(entries.size());
    for (const Entry& entry : entries) sorted_.push_back(entry.trial);
    fill_cells(entries);
  }

  /// Those that belong to a group.
  [[nodiscard]] std::vector<Episode> episodes(const Belongs& belongs) const {
    std::vector<Episode> chosen;
    for (std::size_t k = 0; k < firsts_.size(); ++k) {
      const Episode episode{firsts_[k].scene, firsts_[k].trial,
                            std::span(cells_).subspan(k * arms_, arms_)};
      if (belongs(episode)) chosen.push_back(episode);
    }
    return chosen;
  }

 private:
  struct Entry {
    std::size_t arm;
    std::size_t scene;  ///< Its family.
    const TrialRow* trial;
  };
  static bool of_one_episode(const Entry& a, const Entry& b) {
    return a.trial->episode == b.trial->episode && a.scene == b.scene &&
           a.trial->goal_class == b.trial->goal_class;
  }

  void fill_cells(const std::vector<Entry>& entries) {
    for (std::size_t begin = 0; begin < entries.size();) {
      const std::size_t first = cells_.size();
      cells_.resize(first + arms_);
      std::size_t end = begin;
      while (end < entries.size() && of_one_episode(entries[begin], entries[end])) {
        const std::size_t from = end;
        while (end < entries.size() && entries[end].arm == entries[from].arm &&
               of_one_episode(entries[begin], entries[end])) {
          ++end;
        }
        EpisodeArm& cell = cells_[first + entries[from].arm];
        cell.trials = std::span(sorted_).subspan(from, end - from);
        cell.result = result_of(cell.trials);
      }
      firsts_.push_back(entries[begin]);
      begin = end;
    }
  }

  std::size_t arms_;
  std::vector<const TrialRow*> sorted_;
  std::vector<EpisodeArm> cells_;  ///< Episodes x arms.
  std::vector<Entry> firsts_;      ///< Of each episode.
};

/// Rows of the run's arms that are one arm of the spec, or one of them that was asked for.
struct Family {
  std::string name;
  std::vector<std::size_t> rows;
};

/// A row of one arm and the row that it is compared with, in the same reconstruction.
struct RowPair {
  std::size_t before, after;
  int reconstruction, training;  ///< As in SeededValue.
};

/// What a table is made from.
struct TableInputs {
  const std::vector<ArmRow>& arms;
  SortedTrials trials;
  std::vector<Family> families;
  std::vector<RowPair> pairs;  ///< Of the compared arms.
};

/// Values of the members of one arm, episode by episode.
class SeededValues {
 public:
  void add(const RowPair& of, const Episode& episode, std::size_t index, double value) {
    values_.push_back({of.reconstruction, of.training, static_cast<int>(episode.scene),
                       static_cast<int>(index), value});
  }
  [[nodiscard]] std::vector<double> numbers() const {
    std::vector<double> numbers;
    for (const SeededValue& value : values_) numbers.push_back(value.value);
    return numbers;
  }
  [[nodiscard]] const std::vector<SeededValue>& all() const { return values_; }

 private:
  std::vector<SeededValue> values_;
};

void count_trial(const TrialRow& trial, ArmSummary& summary, int& usable) {
  ++summary.trials;
  if (!trial.counts()) {
    ++(trial.failed() ? summary.failed_trials : summary.excluded_trials);
    return;
  }
  ++usable;
  summary.sim_s += trial.sim_s;
  summary.path_m += trial.path_m;
  summary.contacts += trial.contacts;
  summary.invalid_pixels += trial.invalid_pixel_fraction;
}

/// Number of the row among those of its family in the same reconstruction.
int training_number(const TableInputs& inputs, const Family& family, std::size_t row) {
  int number = 0;
  for (const std::size_t other : family.rows) {
    if (other == row) return number;
    const bool beside = inputs.arms[other].reconstruction == inputs.arms[row].reconstruction;
    number += beside ? 1 : 0;
  }
  return number;
}

ArmSummary summarise_arm(const TableInputs& inputs, const Family& family, Episodes episodes) {
  ArmSummary summary;
  summary.arm = family.name;
  summary.members = static_cast<int>(family.rows.size());
  summary.by_member.resize(family.rows.size());
  std::map<std::string, int> outcomes;
  std::vector<const TrialRow*> all;
  SeededValues successes;
  int usable = 0;
  for (std::size_t k = 0; k < episodes.size(); ++k) {
    for (std::size_t member = 0; member < family.rows.size(); ++member) {
      const std::size_t row = family.rows[member];
      const EpisodeArm& cell = episodes[k].arms[row];
      if (cell.result.usable > 0) {
        for (Proportion* count : {&summary.success, &summary.by_member[member]}) {
          ++count->trials;
          count->successes += cell.result.success ? 1 : 0;
        }
        summary.spl += cell.result.spl;
        summary.soft_spl += cell.result.soft_spl;
        const RowPair of{row, row, inputs.arms[row].reconstruction,
                         training_number(inputs, family, row)};
        successes.add(of, episodes[k], k, cell.result.success ? 1.0 : 0.0);
      }
      for (const TrialRow* trial : cell.trials) {
        ++outcomes[trial->outcome];
        all.push_back(trial);
        count_trial(*trial, summary, usable);
      }
    }
  }
  if (summary.members > 1) {
    summary.pooled_interval = hierarchical_rate_interval(successes.all()).interval;
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

void count_pair(const EpisodeResult& before, const EpisodeResult& after,
                PairedCounts& counts) {
  ++(before.success ? (after.success ? counts.both : counts.only_before)
                    : (after.success ? counts.only_after : counts.neither));
}

PairedMean paired_mean(const SeededValues& differences, bool several) {
  if (!several) {
    const std::vector<double> numbers = differences.numbers();
    return {bootstrap_mean(numbers), sign_flip_p(numbers)};
  }
  return {hierarchical_interval(differences.all()), training_test(differences.all()).p};
}

/// Counts the pairs of one group and tests them.
void compare(const TableInputs& inputs, Episodes episodes, GroupSummary& group) {
  SeededValues success, spl, sim_s, path_m;
  for (std::size_t k = 0; k < episodes.size(); ++k) {
    for (const RowPair& pair : inputs.pairs) {
      const EpisodeResult& before = episodes[k].arms[pair.before].result;
      const EpisodeResult& after = episodes[k].arms[pair.after].result;
      if (before.usable == 0 || after.usable == 0) {
        ++group.dropped_pairs;
        continue;
      }
      count_pair(before, after, group.pairs);
      const auto add = [&](SeededValues& values, double difference) {
        values.add(pair, episodes[k], k, difference);
      };
      add(success, (after.success ? 1.0 : 0.0) - (before.success ? 1.0 : 0.0));
      add(spl, after.spl - before.spl);
      add(sim_s, after.sim_s - before.sim_s);
      add(path_m, after.path_m - before.path_m);
    }
  }
  const bool several = inputs.pairs.size() > 1;
  if (several) {
    const MeanInterval difference = hierarchical_interval(success.all());
    group.difference = {
        difference.mean,
        {std::max(-1.0, difference.interval.low), std::min(1.0, difference.interval.high)}};
    group.training = training_test(success.all());
    group.p = group.training->p;
  } else {
    group.difference = newcombe_paired_difference(group.pairs);
    group.p = mcnemar_exact_p(group.pairs.only_after, group.pairs.only_before);
    group.p_mid = mcnemar_mid_p(group.pairs.only_after, group.pairs.only_before);
  }
  group.p_holm = group.p;
  group.spl = paired_mean(spl, several);
  group.sim_s = paired_mean(sim_s, several);
  group.path_m = paired_mean(path_m, several);
  group.verdict = verdict(group.pairs, group.p, group.difference);
}

GroupSummary summarise_group(const TableInputs& inputs, const std::string& name,
                             const std::string& title, const SortedTrials::Belongs& belongs) {
  GroupSummary group;
  group.name = name;
  group.title = title;
  const std::vector<Episode> episodes = inputs.trials.episodes(belongs);
  for (const Family& family : inputs.families) {
    group.arms.push_back(summarise_arm(inputs, family, episodes));
  }
  if (!inputs.pairs.empty()) compare(inputs, episodes, group);
  return group;
}

std::vector<TrainingSummary> summarise_trainings(const TableInputs& inputs) {
  const std::vector<Episode> episodes =
      inputs.trials.episodes([](const Episode&) { return true; });
  std::vector<TrainingSummary> trainings;
  for (const RowPair& pair : inputs.pairs) {
    TrainingSummary training{
        inputs.arms[pair.after].name, inputs.arms[pair.before].name, {}, {}};
    for (const Episode& episode : episodes) {
      const EpisodeResult& before = episode.arms[pair.before].result;
      const EpisodeResult& after = episode.arms[pair.after].result;
      if (after.usable == 0) continue;
      ++training.success.trials;
      training.success.successes += after.success ? 1 : 0;
      if (before.usable > 0) count_pair(before, after, training.pairs);
    }
    trainings.push_back(std::move(training));
  }
  return trainings;
}

/// Arms of the spec, in the order of the run.
std::vector<Family> arm_families(const std::vector<ArmRow>& arms) {
  std::vector<Family> families;
  for (std::size_t row = 0; row < arms.size(); ++row) {
    const auto known = std::find_if(families.begin(), families.end(), [&](const Family& f) {
      return f.name == family_of(arms[row]);
    });
    if (known != families.end()) {
      known->rows.push_back(row);
    } else {
      families.push_back({family_of(arms[row]), {row}});
    }
  }
  return families;
}

const Family* find_family(const std::vector<Family>& families, const std::string& name) {
  for (const Family& family : families) {
    if (family.name == name) return &family;
  }
  return nullptr;
}

/// An arm of the spec by its name; one row of an arm becomes a family of its own.
/// @throws core::InputError if there is neither.
void require_family(const std::vector<ArmRow>& arms, const std::string& name,
                    std::vector<Family>& families) {
  if (find_family(families, name) != nullptr) return;
  std::string names;
  for (std::size_t row = 0; row < arms.size(); ++row) {
    if (arms[row].name == name) {
      families.push_back({name, {row}});
      return;
    }
    names += (names.empty() ? "" : ", ") + arms[row].name;
  }
  throw core::InputError::expected("arm", "one of " + names, "\"" + name + "\"");
}

/// Rows of `family` in one reconstruction.
std::vector<std::size_t> rows_in(const std::vector<ArmRow>& arms, const Family& family,
                                 int reconstruction) {
  std::vector<std::size_t> rows;
  for (const std::size_t row : family.rows) {
    if (arms[row].reconstruction == reconstruction) rows.push_back(row);
  }
  return rows;
}

/// Rows to compare, in each reconstruction: one with all of the other arm, or, of two arms
/// with several trainings, those of the same seed.
/// @throws core::InputError if they do not pair.
std::vector<RowPair> paired_rows(const std::vector<ArmRow>& arms, const Family& before,
                                 const Family& after) {
  std::vector<RowPair> pairs;
  std::set<int> reconstructions;
  for (const std::size_t row : after.rows) reconstructions.insert(arms[row].reconstruction);
  for (const int r : reconstructions) {
    const std::vector<std::size_t> first = rows_in(arms, before, r);
    const std::vector<std::size_t> second = rows_in(arms, after, r);
    int training = 0;
    for (const std::size_t a : first) {
      for (const std::size_t b : second) {
        const bool same_seed = arms[a].finetune_seed == arms[b].finetune_seed;
        if (first.size() > 1 && second.size() > 1 && !same_seed) continue;
        pairs.push_back({a, b, r, training++});
      }
    }
  }
  if (!pairs.empty()) return pairs;
  throw core::InputError::expected("arms " + before.name + " and " + after.name,
                                   "trainings of the same reconstructions and seeds", "none");
}

/// Fills in table.before, .after and .oracle.
void choose_arms(const std::string& before, const std::string& after,
                 std::vector<Family>& families, ResultTable& table) {
  std::vector<std::string> candidates;
  for (const Family& family : families) {
    if (table.arm_rows[family.rows.front()].detector == "oracle") {
      if (table.oracle.empty()) table.oracle = family.name;
    } else {
      candidates.push_back(family.name);
    }
  }
  const bool named =
      find_family(families, "before") != nullptr && find_family(families, "after") != nullptr;
  if (named) {
    table.before = "before";
    table.after = "after";
  } else if (candidates.size() >= 2) {
    table.before = candidates[0];
    table.after = candidates[1];
  }
  for (const auto& [name, chosen] :
       {std::pair(&before, &table.before), {&after, &table.after}}) {
    if (name->empty()) continue;
    require_family(table.arm_rows, *name, families);
    *chosen = *name;
  }
}

/// Whether different weights are compared: what their training drew is then part of chance.
bool compares_weights(const std::vector<ArmRow>& arms, const std::vector<RowPair>& pairs) {
  return std::any_of(pairs.begin(), pairs.end(), [&](const RowPair& pair) {
    const std::string& after = arms[pair.after].weights_sha256;
    return !after.empty() && after != arms[pair.before].weights_sha256;
  });
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
  TableInputs inputs{
      table.arm_rows, SortedTrials(trials, scenes, arms), arm_families(arms), {}};
  choose_arms(before, after, inputs.families, table);
  if (!table.before.empty() && !table.after.empty()) {
    inputs.pairs = paired_rows(arms, *find_family(inputs.families, table.before),
                               *find_family(inputs.families, table.after));
  }
  table.trainings = summarise_trainings(inputs);
  table.compares_trainings = compares_weights(arms, inputs.pairs);
  for (const TrialRow& trial : trials) table.finished_trials += trial.failed() ? 0 : 1;

  const std::vector<const SceneRow*> families = scene_families(scenes);
  for (std::size_t k = 0; k < families.size(); ++k) {
    const SceneRow& scene = *families[k];
    GroupSummary group = summarise_group(inputs, family_of(scene), scene.title,
                                         [&](const Episode& e) { return e.scene == k; });
    group.leak = internal::is_tuned_on(table, family_of(scene));
    table.scenes.push_back(std::move(group));
  }
  if (families.size() > 1) {
    table.all =
        summarise_group(inputs, "all", "All scenes", [](const Episode&) { return true; });
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
  for (const TrialRow& trial : trials) class_names.insert(trial.goal_class);
  std::vector<double> p_values;
  for (const std::string& name : class_names) {
    table.classes.push_back(summarise_group(
        inputs, name, name, [&](const Episode& e) { return e.first->goal_class == name; }));
    p_values.push_back(table.classes.back().p);
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
