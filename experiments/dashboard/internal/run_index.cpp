#include "experiments/dashboard/internal/run_index.h"

#include <algorithm>
#include <set>
#include <tuple>

#include "core/error.h"
#include "core/file_io.h"

namespace segsim::experiments::dashboard::internal {
namespace {

namespace fs = std::filesystem;
using Seconds = std::chrono::duration<double>;

constexpr int kDeepest = 4;  // Folders below a root: out/runs/flat/shards/0.
constexpr std::size_t kMostDatabases = 500;
constexpr double kLookEvery_s = 3.0, kReadEvery_s = 0.25, kRestFactor = 20.0;
constexpr int kFinishTimes = 200;

/// Folders of a run that hold many files and no other run.
bool is_worth_a_look(const fs::path& folder) {
  const std::string name = folder.filename().string();
  if (name.empty() || name.front() == '.') return false;
  for (const char* known :
       {"scenes", "episodes", "logs", "pictures", "tracks", "videos", "frames", "views",
        "captures", "live", "report", "replays", "source_views", "sensors"}) {
    if (name == known) return false;
  }
  return true;
}

/// Changes whenever somebody has written to the database.
std::string stamp_of(const fs::path& file) {
  std::string stamp;
  for (const char* ending : {"", "-wal"}) {
    std::error_code error;
    const fs::path part = file.string() + ending;
    const auto size = fs::file_size(part, error);
    const auto time = fs::last_write_time(part, error);
    if (!error) {
      stamp +=
          std::to_string(size) + "/" + std::to_string(time.time_since_epoch().count()) + ";";
    }
  }
  return stamp;
}

/// Short, and equal for the same place whenever the server is started.
std::string key_of(const fs::path& place, const std::string& run) {
  return core::sha256_hex(place.string()).substr(0, 10) + "." + run;
}

bool is_shard(const fs::path& file) {
  return file.parent_path().parent_path().filename() == "shards";
}

fs::path work_of_shard(const fs::path& file) {
  return file.parent_path().parent_path().parent_path();
}

std::chrono::steady_clock::time_point later(double seconds) {
  using Clock = std::chrono::steady_clock;
  return Clock::now() + std::chrono::duration_cast<Clock::duration>(Seconds(seconds));
}

}  // namespace

RunPointer combined_run(const fs::path& work, const RunPointer& merged,
                        const std::vector<RunPointer>& shards) {
  std::vector<RunPointer> parts = shards;
  if (merged != nullptr) parts.push_back(merged);
  auto run = std::make_shared<RunSnapshot>();
  run->stored = (merged != nullptr ? merged : shards.front())->stored;
  run->stored.folder = work;
  run->stored.trials.clear();
  run->key = key_of(work, run->stored.run.spec_sha256.substr(0, 8));
  if (merged == nullptr) run->stored.run.ended.clear();  // The parts' own ends say nothing.
  const auto numbers = static_cast<std::int64_t>(parts.size());
  std::set<std::tuple<std::string, std::string, int>> taken;
  for (const bool failed : {false, true}) {
    for (std::size_t k = 0; k < parts.size(); ++k) {
      const fs::path below = parts[k]->stored.folder.lexically_relative(work);
      for (records::TrialRow trial : parts[k]->stored.trials) {
        if (trial.failed() != failed) continue;
        if (!taken.emplace(trial.arm, trial.episode, trial.repetition).second) continue;
        trial.trial_id = trial.trial_id * numbers + static_cast<std::int64_t>(k);
        if (!trial.log.empty()) trial.log = (below / trial.log).lexically_normal().string();
        run->stored.trials.push_back(std::move(trial));
      }
    }
  }
  for (const RunPointer& part : parts) {
    run->stored.run.started = std::min(run->stored.run.started, part->stored.run.started);
    run->finish_times.insert(run->finish_times.end(), part->finish_times.begin(),
                             part->finish_times.end());
    run->live_folders.push_back(part->stored.folder);
  }
  std::sort(run->finish_times.rbegin(), run->finish_times.rend());
  run->table = results::summarise(run->stored);
  return run;
}

RunIndex::RunIndex(std::vector<fs::path> roots) : roots_(std::move(roots)) {
  for (fs::path& root : roots_) {
    std::error_code error;
    if (!fs::exists(root, error)) {
      throw core::InputError::expected(root.string(), "a folder of runs, or their database",
                                       "none");
    }
    root = fs::canonical(root);
  }
}

void RunIndex::look_for_databases() {
  if (Clock::now() < next_look_) return;
  next_look_ = later(kLookEvery_s);
  const auto add = [&](const fs::path& file) {
    if (databases_.size() < kMostDatabases) databases_.try_emplace(file);
  };
  for (const fs::path& root : roots_) {
    std::error_code error;
    if (!fs::is_directory(root, error)) {
      add(root);
      continue;
    }
    auto at = fs::recursive_directory_iterator(
        root, fs::directory_options::skip_permission_denied, error);
    if (error) continue;
    for (; at != fs::recursive_directory_iterator(); at.increment(error)) {
      if (error) break;
      std::error_code gone;
      if (at->is_directory(gone)) {
        if (at.depth() >= kDeepest || !is_worth_a_look(at->path())) {
          at.disable_recursion_pending();
        }
      } else if (at->path().filename() == "results.sqlite") {
        add(at->path());
      }
    }
  }
}

void RunIndex::read(const fs::path& file, Database& database) {
  const Clock::time_point start = Clock::now();
  database.stamp = stamp_of(file);
  try {
    const records::Store store = records::Store::for_reading(file);
    std::vector<RunPointer> runs;
    for (const records::RunRow& row : store.runs()) {
      auto run = std::make_shared<RunSnapshot>();
      run->key = key_of(file, std::to_string(row.run_id));
      run->live_folders = {file.parent_path()};
      run->stored = {file.parent_path(), row, store.scenes(row.run_id), store.arms(row.run_id),
                     store.trials(row.run_id)};
      run->table = results::summarise(run->stored);
      run->finish_times = store.finish_times(row.run_id, kFinishTimes);
      runs.push_back(std::move(run));
    }
    database.runs = std::move(runs);
    database.problem.clear();
  } catch (const std::exception& error) {
    database.problem = error.what();  // What was read before stays on show.
  }
  const double took_s = Seconds(Clock::now() - start).count();
  database.next = later(std::max(kReadEvery_s, kRestFactor * took_s));
}

void RunIndex::combine() {
  struct Parts {
    RunPointer merged;
    std::vector<RunPointer> shards;
  };
  std::map<std::pair<fs::path, std::string>, Parts> sharded;  // By work folder and spec.
  for (const auto& [file, database] : databases_) {
    if (database.runs.empty() || !is_shard(file)) continue;
    const RunPointer& last = database.runs.back();
    sharded[{work_of_shard(file), last->stored.run.spec_sha256}].shards.push_back(last);
  }
  shown_.clear();
  for (const auto& [file, database] : databases_) {
    if (is_shard(file)) continue;
    for (const RunPointer& run : database.runs) {
      const auto parts = sharded.find({file.parent_path(), run->stored.run.spec_sha256});
      if (parts == sharded.end()) {
        shown_.push_back(run);
      } else {
        parts->second.merged = run;
      }
    }
  }
  for (const auto& [place, parts] : sharded) {
    shown_.push_back(combined_run(place.first, parts.merged, parts.shards));
  }
  std::stable_sort(shown_.begin(), shown_.end(), [](const RunPointer& a, const RunPointer& b) {
    return a->stored.run.started > b->stored.run.started;
  });
}

void RunIndex::refresh() {
  look_for_databases();
  bool changed = false;
  for (auto& [file, database] : databases_) {
    if (Clock::now() < database.next) continue;
    if (database.stamp == stamp_of(file) && database.problem.empty()) continue;
    read(file, database);
    changed = true;
  }
  if (changed) combine();
}

std::vector<RunPointer> RunIndex::runs() {
  const std::lock_guard<std::mutex> lock(mutex_);
  refresh();
  return shown_;
}

RunPointer RunIndex::find(const std::string& key) {
  const std::vector<RunPointer> all = runs();
  const auto found = std::find_if(all.begin(), all.end(),
                                  [&](const RunPointer& run) { return run->key == key; });
  return found == all.end() ? nullptr : *found;
}

std::vector<std::string> RunIndex::problems() {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<std::string> texts;
  for (const auto& [file, database] : databases_) {
    if (!database.problem.empty()) texts.push_back(database.problem);
  }
  return texts;
}

}  // namespace segsim::experiments::dashboard::internal
