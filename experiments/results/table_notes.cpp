// Notes below a table of results.
#include "experiments/results/table_notes.h"

#include <algorithm>
#include <cstdio>
#include <string_view>

#include "core/formatted.h"
#include "core/process/kernel_choice.h"
#include "experiments/results/leakage.h"

namespace segsim::experiments::results::internal {
namespace {

constexpr double kOracleExpected = 0.95;

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
    const bool several = table.trainings.size() > 1;
    table.notes.push_back(
        count_of(dropped, several ? "pair of an episode and a training" : "episode") +
        " without a usable trial in both arms are in no pair.");
  }
}

/// Episodes that cannot be done are in no rate, but not silently.
void note_excluded(ResultTable& table, const std::vector<records::TrialRow>& trials) {
  constexpr std::size_t kListed = 8;
  for (const auto outcome :
       {records::TrialOutcome::kInfeasible, records::TrialOutcome::kTrivial}) {
    std::vector<std::string> ids;
    for (const records::TrialRow& trial : trials) {
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
    table.notes.push_back(count_of(static_cast<int>(ids.size()), "episode") + " " +
                          to_string(outcome) + ", in no rate: " + list + ".");
  }
}

/// Whether the sets themselves can be solved (segsim episodes validate).
void note_validation(ResultTable& table) {
  for (const records::SceneRow& scene : table.scene_rows) {
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
  records::StartLeak leak;
  for (const TrainingSummary& training : table.trainings) {
    const records::ArmRow* after = find_arm(table.arm_rows, training.arm);
    if (after == nullptr || !after->start_leak) continue;
    leak.views += after->start_leak->views;
    leak.near_starts += after->start_leak->near_starts;
    leak.radius_m = after->start_leak->radius_m;
  }
  if (leak.views == 0) return;
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

/// Whether the detector under test was shown what the robot sees where trials succeed.
std::optional<StopRegion> stop_region(const ResultTable& table,
                                      const std::vector<records::TrialRow>& trials) {
  StopRegion region;
  int views = 0;
  for (const records::TrialRow& trial : trials) {
    const records::ArmRow* arm = find_arm(table.arm_rows, trial.arm);
    if (arm == nullptr || records::family_of(*arm) != table.after || !arm->start_leak)
      continue;
    if (!trial.counts() || !trial.success || trial.why.stop_views < 0) continue;
    ++region.successes;
    if (trial.why.stop_views > 0) ++region.near_views;
    views += trial.why.stop_views;
  }
  if (region.successes == 0) return std::nullopt;
  region.mean_views = static_cast<double>(views) / region.successes;
  return region;
}

void note_stop_region(ResultTable& table) {
  if (!table.stop_region) return;
  const StopRegion& region = *table.stop_region;
  table.notes.push_back((region.near_views > 0 ? "LEAKAGE stop region: " : "Stop region: ") +
                        std::to_string(region.near_views) + " of the " +
                        count_of(region.successes, "successful trial") + " of \"" +
                        table.after + "\" ended within " +
                        core::print("%g", records::kStopRegion_m) +
                        " m of a view that it was fine-tuned on and that shows the goal" +
                        core::print(" (%.1f of its views, on average).", region.mean_views));
}

/// Goals that the detector did not know before it was tuned.
void note_new_classes(ResultTable& table) {
  const auto found = table.run.provenance.find("new_classes");
  if (found == table.run.provenance.end()) return;
  table.notes.push_back("New classes: \"" + table.before + "\" does not know " +
                        found->second +
                        ", and no trial for them can succeed by it; fine-tuning gave \"" +
                        table.after + "\" heads of their own for them. The AP50 of \"" +
                        table.before + "\" is that of the classes that it knows.");
  const auto untaught = table.run.provenance.find("untaught_goals");
  if (untaught == table.run.provenance.end()) return;
  table.notes.push_back(
      "Untaught goals: where a detector is tuned on other scenes, none of these shows " +
      untaught->second + ". No trial for them can succeed there by it.");
}

/// Labels that fine-tuning learns from, where they are not the truth.
void note_masks(ResultTable& table) {
  static constexpr std::string_view kPrefix = "masks/";
  for (const auto& [name, words] : table.run.provenance) {
    if (!name.starts_with(kPrefix)) continue;
    table.notes.push_back("Labels of " + name.substr(kPrefix.size()) + " for \"" +
                          table.after + "\" were learnt from masks: " + words +
                          ". Success is judged by the exact ones.");
  }
}

/// The effect that this comparison is an experiment about.
void note_paper(ResultTable& table) {
  const bool tuned = std::any_of(table.scenes.begin(), table.scenes.end(),
                                 [](const GroupSummary& scene) { return scene.leak; });
  if (!tuned) return;
  table.notes.emplace_back(
      "The paper reports for this adaptation, in its own scenes, SR 20 % -> 100 % "
      "(laboratory) "
      "and 25 % -> 50 % (house). It does not say how many episodes that were, so neither an "
      "interval nor a p-value can be given for it.");
}

void note_several_trainings(ResultTable& table) {
  table.notes.push_back(
      "SR: successes/(episodes x trainings); where an arm has several trainings, with a 95 % "
      "interval that counts what differs between reconstructions, trainings and "
      "episodes, else Wilson's. p: two-sided test of \"" +
      table.before + "\" against \"" + table.after +
      "\" over trainings and episodes; pairs +b -c, summed over trainings: b only after, c "
      "only before. Difference: the interval of the same kind "
      "(docs/metrics.md).");
}

void note_one_training(ResultTable& table) {
  table.notes.push_back(
      "SR: successes/episodes, Wilson 95 % interval. p: exact two-sided McNemar test of \"" +
      table.before + "\" against \"" + table.after +
      "\" on the same episodes; pairs +b -c: b only after, c only before. Difference: "
      "Newcombe's "
      "paired 95 % interval; where it disagrees with p, the test decides.");
  if (table.compares_trainings) {
    table.notes.push_back(
        "ONE TRAINING: \"" + table.after +
        "\" is one draw of its training. The interval knows nothing of how trainings differ "
        "(`repetitions: {finetune_seeds: N}` in the spec measures it).");
  }
  for (const GroupSummary& scene : table.scenes) {
    if (scene.pairs.discordant() < kMinDiscordantPairs) {
      table.notes.push_back(scene.title + ": " +
                            count_of(scene.pairs.discordant(), "discordant pair") +
                            "; at least 6, all one way, are needed for p < 0.05.");
    }
  }
}

/// What stands for many files in the grids above.
void note_own_weights(ResultTable& table) {
  const bool any =
      std::any_of(table.run.provenance.begin(), table.run.provenance.end(),
                  [](const auto& row) { return row.first.starts_with("weights/"); });
  if (!any) return;
  table.notes.emplace_back(
      "Arms with weights of their own in every scene: AP50, score threshold and their like "
      "are means over scenes, and the hash of the weights is that of the list of all.");
}

void note_comparison(ResultTable& table) {
  if (table.before.empty() || table.after.empty()) {
    table.notes.emplace_back("Rates: Wilson 95 % interval.");
    note_leakage(table);
    return;
  }
  if (table.trainings.size() > 1) {
    note_several_trainings(table);
  } else {
    note_one_training(table);
  }
  note_leakage(table);
  note_start_region(table);
  note_new_classes(table);
  note_masks(table);
  note_paper(table);
  note_own_weights(table);
  if (table.scenes.size() < kScenesForClaim) {
    table.notes.emplace_back(
        "Fewer than 5 scenes: no claim beyond these scenes is supported.");
  }
}

/// A robot that gives up may stand where another rule would call it a success.
void note_any_stop(ResultTable& table) {
  for (const GroupSummary& scene : table.scenes) {
    std::string arms;
    for (const ArmSummary& arm : scene.arms) {
      const TrialInsights& seen = arm.insights;
      if (seen.profiles.empty()) continue;
      if (seen.any_stop_successes == seen.profiles.front().successes) continue;
      arms += (arms.empty() ? "" : ", ") + arm.arm + " " +
              std::to_string(seen.any_stop_successes) + "/" + std::to_string(seen.trials) +
              " instead of " + std::to_string(seen.profiles.front().successes);
    }
    if (arms.empty()) continue;
    table.notes.push_back(
        scene.title + ": some trials gave up in sight of the goal. " +
        sim::success_profiles().front().name +
        " counts a STOP only of a policy that says that it found the goal, the rules of "
        "others any STOP; if it did the same, " +
        arms + " would succeed.");
  }
}

void note_oracle(ResultTable& table) {
  if (table.oracle.empty()) {
    table.notes.emplace_back(
        "No oracle arm: whether the episodes can be solved is not known.");
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
  const records::RunRow& run = table.run;
  table.notes.push_back("Success profile: " + run.success_profile + ".");
  const auto kernels = run.provenance.find("kernels");
  if (kernels != run.provenance.end() &&
      kernels->second == core::to_string(core::KernelChoice::kFast)) {
    table.notes.emplace_back(
        "Made with fast kernels: another processor may get other numbers (segsim without "
        "--fast "
        "computes the same bits everywhere).");
  }
  std::string hashes;
  for (const records::SceneRow& scene : table.scene_rows) {
    hashes += (hashes.empty() ? "" : "; ") + scene.name + " scene " +
              scene.scene_sha256.substr(0, 12) + " episodes " +
              scene.episodes_sha256.substr(0, 12);
  }
  for (const records::ArmRow& arm : table.arm_rows) {
    if (arm.weights_sha256.empty()) continue;
    hashes += "; " + arm.name + " weights " + arm.weights_sha256.substr(0, 12);
  }
  table.notes.push_back(
      "Run " + std::to_string(run.run_id) + " of " + run.name + ", seed " +
      std::to_string(run.seed) + ", planned n " +
      (run.planned_n > 0 ? std::to_string(run.planned_n) : std::string("= all")) +
      ", segsim " + run.code_version +
      (kernels != run.provenance.end() ? ", " + kernels->second + " kernels" : "") +
      ", spec " + run.spec_sha256.substr(0, 12) + ", started " + run.started + " on " +
      run.host + ". " + hashes + ".");
}

}  // namespace

const records::ArmRow* find_arm(const std::vector<records::ArmRow>& arms,
                                const std::string& name) {
  for (const records::ArmRow& arm : arms) {
    if (arm.name == name) return &arm;
  }
  return nullptr;
}

void add_notes(ResultTable& table, const std::vector<records::TrialRow>& trials) {
  note_state_of_run(table);
  note_excluded(table, trials);
  table.stop_region = stop_region(table, trials);
  note_stop_region(table);
  note_validation(table);
  note_comparison(table);
  note_any_stop(table);
  note_oracle(table);
  note_provenance(table);
}

}  // namespace segsim::experiments::results::internal
