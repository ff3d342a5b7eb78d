#include "experiments/results/stored_run.h"

#include "core/error.h"

namespace segsim::experiments::results {
namespace {

/// The run of that number, or the last one.
records::RunRow chosen_run(const records::Store& store, const std::filesystem::path& file,
                           std::int64_t run_id) {
  const std::vector<records::RunRow> runs = store.runs();
  if (runs.empty()) throw core::InputError::expected(file.string(), "a run", "none");
  if (run_id == 0) return runs.back();
  for (const records::RunRow& run : runs) {
    if (run.run_id == run_id) return run;
  }
  throw core::InputError::expected("--run", "1 to " + std::to_string(runs.back().run_id),
                                   std::to_string(run_id));
}

}  // namespace

StoredRun load_run(const std::filesystem::path& work, std::int64_t run_id) {
  const std::filesystem::path file =
      std::filesystem::is_directory(work) ? work / "results.sqlite" : work;
  if (!std::filesystem::exists(file)) {
    throw core::InputError::expected(file.string(), "a results database", "none");
  }
  const records::Store store(file);
  StoredRun stored;
  stored.folder = file.parent_path();
  stored.run = chosen_run(store, file, run_id);
  stored.scenes = store.scenes(stored.run.run_id);
  stored.arms = store.arms(stored.run.run_id);
  stored.trials = store.trials(stored.run.run_id);
  return stored;
}

ResultTable summarise(const StoredRun& stored, const std::string& before,
                      const std::string& after) {
  return summarise(stored.run, stored.scenes, stored.arms, stored.trials, before, after);
}

}  // namespace segsim::experiments::results
