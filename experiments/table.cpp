#include "experiments/table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>

#include "core/config.h"
#include "core/error.h"

namespace segsim::experiments {
namespace {

constexpr double kOracleExpected = 0.95;

/// Trials of one episode, by arm.
using EpisodeTrials = std::map<std::string, std::vector<const TrialRow*>>;

/// What one arm made of one episode; nothing if no usable trial exists.
struct EpisodeResult {
  bool success = false;
  double spl = 0.0, soft_spl = 0.0;
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
  }
  if (usable == 0) return std::nullopt;
  result.success = 2 * successes > usable;
  result.spl /= usable;
  result.soft_spl /= usable;
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
  std::vector<double> spl_differences;
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
    spl_differences.push_back(second->spl - first->spl);
  }
  group.p_exact = mcnemar_exact_p(group.pairs.only_after, group.pairs.only_before);
  group.p_mid = mcnemar_mid_p(group.pairs.only_after, group.pairs.only_before);
  group.p_holm = group.p_exact;
  group.p_spl = sign_flip_p(spl_differences);
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

const ArmRow* find_arm(const std::vector<ArmRow>& arms, const std::string& name) {
  for (const ArmRow& arm : arms) {
    if (arm.name == name) return &arm;
  }
  return nullptr;
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

std::string count_of(int count, const std::string& noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

void note_state_of_run(ResultTable& table) {
  if (table.finished_trials < table.run.planned_trials) {
    table.notes.push_back("INTERIM: " + std::to_string(table.finished_trials) + " of " +
                          count_of(table.run.planned_trials, "trial") +
                          " finished; intervals and p-values are not final.");
  }
  int failed = 0, dropped = 0;
  for (const GroupSummary& scene : table.scenes) {
    for (const ArmSummary& arm : scene.arms) failed += arm.failed_trials;
    dropped += scene.dropped_pairs;
  }
  if (failed > 0) {
    table.notes.push_back(
        count_of(failed, "trial") +
        " failed in the harness and are in no rate; run again to repeat them.");
  }
  if (dropped > 0 && !table.before.empty()) {
    table.notes.push_back(count_of(dropped, "episode") +
                          " without a usable trial in both arms are in no pair.");
  }
}

/// Episodes that cannot be done are in no rate, but not silently.
void note_excluded(ResultTable& table, const std::vector<TrialRow>& trials) {
  constexpr std::size_t kListed = 8;
  for (const char* outcome : {"infeasible", "trivial"}) {
    std::vector<std::string> ids;
    for (const TrialRow& trial : trials) {
      if (trial.outcome != outcome) continue;
      if (std::find(ids.begin(), ids.end(), trial.episode) == ids.end()) {
        ids.push_back(trial.episode);
      }
    }
    if (ids.empty()) continue;
    std::string list;
    for (std::size_t i = 0; i < ids.size() && i < kListed; ++i) {
      list += (list.empty() ? "" : ", ") + ids[i];
    }
    if (ids.size() > kListed) list += ", ...";
    table.notes.push_back(count_of(static_cast<int>(ids.size()), "episode") + " " + outcome +
                          ", in no rate: " + list + ".");
  }
}

/// Whether the sets themselves can be solved (segsim episodes validate).
void note_validation(ResultTable& table) {
  for (const SceneRow& scene : table.scene_rows) {
    if (scene.oracle_episodes <= 0) continue;
    const double rate = static_cast<double>(scene.oracle_successes) / scene.oracle_episodes;
    const std::string count =
        std::to_string(scene.oracle_successes) + "/" + std::to_string(scene.oracle_episodes);
    table.notes.push_back(
        rate < kOracleExpected
            ? "FLAGGED episodes: " + scene.title + ": the oracle-path arm solved " + count +
                  ", below 0.95; these episodes are part of the failures."
            : scene.title + ": the oracle-path arm solved " + count + " of the episode set.");
  }
}

/// Whether the detector under test was shown what the robot sees where episodes begin.
void note_start_region(ResultTable& table) {
  const ArmRow* after = find_arm(table.arm_rows, table.after);
  if (after == nullptr || !after->start_leak) return;
  const StartLeak& leak = *after->start_leak;
  char radius[16];
  std::snprintf(radius, sizeof radius, "%g", leak.radius_m);
  const std::string counts = std::to_string(leak.near_starts) + " of the " +
                             count_of(leak.views, "view") + " that \"" + table.after +
                             "\" was fine-tuned on";
  table.notes.push_back(leak.near_starts > 0
                            ? "LEAKAGE start region: " + counts + " lie within " + radius +
                                  " m of the start of an evaluation episode."
                            : "Start region: " + counts + " lie within " + radius +
                                  " m of the start of an evaluation episode.");
}

/// The effect that this comparison is an experiment about.
void note_paper(ResultTable& table) {
  const bool tuned = std::any_of(table.scenes.begin(), table.scenes.end(),
                                 [](const GroupSummary& scene) { return scene.leak; });
  if (!tuned) return;
  table.notes.push_back(
      "The paper reports for this adaptation, in its own scenes, SR 20 % -> 100 % "
      "(laboratory) "
      "and 25 % -> 50 % (house). It does not say how many episodes that were, so neither an "
      "interval nor a p-value can be given for it.");
}

void note_comparison(ResultTable& table) {
  if (table.before.empty() || table.after.empty()) {
    table.notes.push_back("Rates: Wilson 95 % interval.");
    return;
  }
  table.notes.push_back(
      "SR: successes/episodes, Wilson 95 % interval. p: exact two-sided McNemar test of \"" +
      table.before + "\" against \"" + table.after +
      "\" on the same episodes; pairs +b -c: b only after, c only before. Difference: "
      "Newcombe's "
      "paired 95 % interval; where it disagrees with p, the test decides.");
  for (const GroupSummary& scene : table.scenes) {
    if (scene.pairs.discordant() < kMinDiscordantPairs) {
      table.notes.push_back(scene.title + ": " +
                            count_of(scene.pairs.discordant(), "discordant pair") +
                            "; at least 6, all one way, are needed for p < 0.05.");
    }
  }
  for (const GroupSummary& scene : table.scenes) {
    if (!scene.leak) continue;
    table.notes.push_back(
        "LEAKAGE scene (*): \"" + table.after +
        "\" was fine-tuned on views rendered from the scenes marked * (this is "
        "the adaptation under test; it says nothing about unseen scenes).");
    break;
  }
  note_start_region(table);
  note_paper(table);
  if (table.scenes.size() < 5) {
    table.notes.push_back("Fewer than 5 scenes: no claim beyond these scenes is supported.");
  }
}

void note_oracle(ResultTable& table) {
  if (table.oracle.empty()) {
    table.notes.push_back("No oracle arm: whether the episodes can be solved is not known.");
    return;
  }
  for (const GroupSummary& scene : table.scenes) {
    const ArmSummary* oracle = scene.find(table.oracle);
    if (oracle == nullptr || oracle->success.trials == 0) continue;
    if (oracle->success.value() >= kOracleExpected) continue;
    table.notes.push_back(scene.title + ": oracle SR " +
                          std::to_string(oracle->success.successes) + "/" +
                          std::to_string(oracle->success.trials) +
                          " is below 0.95: part of the failures is navigation's, not the "
                          "detector's.");
  }
}

void note_provenance(ResultTable& table) {
  const RunRow& run = table.run;
  table.notes.push_back("Success profile: " + run.success_profile + ".");
  std::string hashes;
  for (const SceneRow& scene : table.scene_rows) {
    hashes += (hashes.empty() ? "" : "; ") + scene.name + " scene " +
              scene.scene_sha256.substr(0, 12) + " episodes " +
              scene.episodes_sha256.substr(0, 12);
  }
  for (const ArmRow& arm : table.arm_rows) {
    if (arm.weights_sha256.empty()) continue;
    hashes += "; " + arm.name + " weights " + arm.weights_sha256.substr(0, 12);
  }
  table.notes.push_back(
      "Run " + std::to_string(run.run_id) + " of " + run.name + ", seed " +
      std::to_string(run.seed) + ", planned n " +
      (run.planned_n > 0 ? std::to_string(run.planned_n) : std::string("= all")) +
      ", segsim " + run.code_version + ", spec " + run.spec_sha256.substr(0, 12) +
      ", started " + run.started + " on " + run.host + ". " + hashes + ".");
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

  note_state_of_run(table);
  note_excluded(table, trials);
  note_validation(table);
  note_comparison(table);
  note_oracle(table);
  note_provenance(table);
  return table;
}

TableFormat table_format_from(const std::string& word) {
  const std::vector<std::string> words{"text", "md", "csv", "json"};
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (word == words[i]) return static_cast<TableFormat>(i);
  }
  const std::string near = core::nearest_word(word, words);
  throw core::InputError::expected(
      "--format", "text | md | csv | json",
      "\"" + word + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
}

}  // namespace segsim::experiments
