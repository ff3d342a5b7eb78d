// What the store costs: adding a trial, reading a run to go on with it, its table.
#include "experiments/records/store.h"

#include <map>
#include <string>

#include <benchmark/benchmark.h>
#include <sqlite3.h>

#include "core/check.h"
#include "experiments/results/stored_run.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

constexpr int kScenes = 10;

std::int64_t begin(Store& store) {
  RunRow run;
  run.name = run.title = "bench";
  run.success_profile = "p";
  std::vector<SceneRow> scenes;
  for (int k = 0; k < kScenes; ++k) {
    const std::string name = "scene-" + std::to_string(k);
    scenes.push_back({name, name, "s", "e", 0});
  }
  return store.begin_run(run, scenes,
                         {{"before", "a", "c", "", -1, {}}, {"after", "b", "d", "", -1, {}}});
}

/// Two arms and ten scenes; half of the trials of "before" and nine tenths of "after" succeed.
/// All in one transaction: only reading is measured with it.
fs::path run_of(const fs::path& folder, std::int64_t trials) {
  const fs::path file = folder / (std::to_string(trials) + ".sqlite");
  if (fs::exists(file)) return file;
  {
    Store store(file);
    (void)begin(store);
  }
  sqlite3* db = nullptr;
  SEGSIM_CHECK(sqlite3_open(file.c_str(), &db) == SQLITE_OK, file.string());
  const std::string sql =
      "BEGIN; WITH RECURSIVE k(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM k WHERE i + 1 < " +
      std::to_string(trials) +
      ") INSERT INTO trial SELECT i + 1, 1, CASE i % 2 WHEN 0 THEN 'before' ELSE 'after' END, "
      "'scene-' || (i / 2 % 10), 'scene-' || (i / 2 % 10) || '/chair/' || (i / 2), "
      "'class-' || (i / 2 % 7), 0, CASE WHEN (i * 7919 / 2) % 10 < 5 + 4 * (i % 2) THEN "
      "'success' ELSE 'timeout' END, (i * 7919 / 2) % 10 < 5 + 4 * (i % 2), 'goal_reached', "
      "0.5, "
      "0.5, 5.0 + i % 11, 4.0, 0.5, 20.0 + i % 13, 1.0, 80, 0, 0.0, 10, 12, 0.001, "
      "'fedcba9876543210', 10.0, 5.0, 3.0, '', 'pictures/scene/chair.png', '', 'tracks/t', "
      "'2026-01-01T00:00:00Z' FROM k;"
      "INSERT INTO attribution SELECT trial_id, CASE success WHEN 1 THEN 'did_not_fail' ELSE "
      "'false_positive' END, 70, 60, 20, 10, 10, 3, 12, 1, 1, 1, 50, 0.5, 0.5, 3.0, 0, 0, 1, "
      "'logs/scene/chair.json.gz', 80 FROM trial; COMMIT;";
  char* message = nullptr;
  const int code = sqlite3_exec(db, sql.c_str(), nullptr, nullptr, &message);
  SEGSIM_CHECK(code == SQLITE_OK, message == nullptr ? "" : message);
  sqlite3_close(db);
  return file;
}

const fs::path& folder() {
  static const tests::TemporaryFolder made("store_bench");
  return made.path();
}

void BM_AddTrial(benchmark::State& state) {
  Store store(folder() / "add.sqlite");
  const std::int64_t run_id = begin(store);
  TrialRow trial;
  trial.arm = "before";
  trial.scene = "scene-0";
  trial.outcome = "success";
  trial.why.cause = "did_not_fail";
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
    const Store store(file);
    const std::size_t found = store.trials(store.runs().back().run_id).size();
    SEGSIM_CHECK(static_cast<std::int64_t>(found) == state.range(0), std::to_string(found));
  }
}
BENCHMARK(BM_ReadToResume)->Arg(10'000)->Unit(benchmark::kMillisecond);

void BM_Table(benchmark::State& state) {
  const fs::path file = run_of(folder(), state.range(0));
  for (auto _ : state) {
    const ResultTable table = summarise(load_run(file));
    SEGSIM_CHECK(table.all->pairs.total() == state.range(0) / 2, "every episode is a pair");
    benchmark::DoNotOptimize(format_table(table, TableFormat::kText));
  }
}
BENCHMARK(BM_Table)->Arg(100'000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace segsim::experiments
