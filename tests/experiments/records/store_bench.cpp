// What the store costs: adding a trial, reading a run to go on with it, its table.
#include "experiments/records/store.h"

#include <cstdint>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include "core/check.h"
#include "experiments/results/stored_run.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

constexpr int kScenes = 10;

std::int64_t begin(records::Store& store) {
  records::RunRow run;
  run.name = run.title = "bench";
  run.success_profile = "p";
  std::vector<records::SceneRow> scenes;
  for (int k = 0; k < kScenes; ++k) {
    const std::string name = "scene-" + std::to_string(k);
    scenes.push_back({name, name, "s", "e", 0});
  }
  return store.begin_run(run, scenes,
                         {{"before", "a", "c", "", -1, {}}, {"after", "b", "d", "", -1, {}}});
}

/// Of two arms and ten scenes; half of the trials of "before" and nine tenths of "after"
/// succeed.
records::TrialRow trial_of(std::int64_t number) {
  const std::int64_t episode = number / 2;
  const bool after = number % 2 == 1;
  records::TrialRow trial;
  trial.arm = after ? "after" : "before";
  trial.scene = "scene-" + std::to_string(episode % kScenes);
  trial.episode = trial.scene + "/chair/" + std::to_string(episode);
  trial.goal_class = "class-" + std::to_string(episode % 7);
  trial.success = number * 7919 / 2 % 10 < (after ? 9 : 5);
  trial.outcome =
      trial.success ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
  trial.stop_reason = core::StopReason::kGoalReached;
  trial.spl = trial.soft_spl = 0.5;
  trial.path_m = 5.0 + static_cast<double>(number % 11);
  trial.shortest_path_m = 4.0;
  trial.distance_to_goal_m = 0.5;
  trial.sim_s = 20.0 + static_cast<double>(number % 13);
  trial.wall_s = 1.0;
  trial.ticks = 80;
  trial.state_hash = 0xfedcba9876543210ULL;
  trial.picture = "pictures/scene/chair.png";
  trial.log = "logs/scene/chair.json.gz";
  trial.why.cause =
      trial.success ? records::Cause::kDidNotFail : records::Cause::kFalsePositive;
  trial.why.images = 80;
  trial.why.visible_frames = trial.why.detected_frames = 10;
  return trial;
}

/// All in one transaction: only reading is measured with it.
fs::path run_of(const fs::path& folder, std::int64_t trials) {
  const fs::path file = folder / (std::to_string(trials) + ".sqlite");
  if (fs::exists(file)) return file;
  std::vector<records::TrialRow> rows;
  for (std::int64_t k = 0; k < trials; ++k) rows.push_back(trial_of(k));
  records::Store store(file);
  store.add_trials(begin(store), rows);
  return file;
}

const fs::path& folder() {
  static const tests::TemporaryFolder made("store_bench");
  return made.path();
}

void BM_AddTrial(benchmark::State& state) {
  records::Store store(folder() / "add.sqlite");
  const std::int64_t run_id = begin(store);
  records::TrialRow trial;
  trial.arm = "before";
  trial.scene = "scene-0";
  trial.outcome = records::TrialOutcome::kSuccess;
  trial.why.cause = records::Cause::kDidNotFail;
  int number = 0;
  for (auto _ : state) {
    trial.episode = "scene-0/chair/" + std::to_string(number++);
    store.add_trial(run_id, trial);
  }
}
BENCHMARK(BM_AddTrial)->Unit(benchmark::kMillisecond)->UseRealTime();

/// What `segsim run` reads before it knows which trials are missing.
void BM_ReadToResume(benchmark::State& state) {
  const fs::path file = run_of(folder(), state.range(0));
  for (auto _ : state) {
    const records::Store store(file);
    const std::size_t found = store.trials(store.runs().back().run_id).size();
    SEGSIM_CHECK(static_cast<std::int64_t>(found) == state.range(0), std::to_string(found));
  }
}
BENCHMARK(BM_ReadToResume)->Arg(10'000)->Unit(benchmark::kMillisecond);

void BM_Table(benchmark::State& state) {
  const fs::path file = run_of(folder(), state.range(0));
  for (auto _ : state) {
    const results::ResultTable table = results::summarise(results::load_run(file));
    SEGSIM_CHECK(table.all->pairs.total() == state.range(0) / 2, "every episode is a pair");
    benchmark::DoNotOptimize(results::format_table(table, support::TableFormat::kText));
  }
}
BENCHMARK(BM_Table)->Arg(100'000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace segsim::experiments
