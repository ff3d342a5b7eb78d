#include "experiments/results/internal/group_summary.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <span>

#include "experiments/results/statistics.h"
#include "experiments/results/training_statistics.h"

namespace segsim::experiments::results::internal {
namespace {

using Episodes = std::span<const Episode>;

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

void count_trial(const records::TrialRow& trial, ArmSummary& summary, int& usable) {
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
  std::vector<const records::TrialRow*> all;
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
      for (const records::TrialRow* trial : cell.trials) {
        ++outcomes[to_string(trial->outcome)];
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

}  // namespace

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

}  // namespace segsim::experiments::results::internal
