#include "experiments/dashboard/internal/run_index.h"

#include <algorithm>

#include "core/error.h"
#include "core/file_io.h"

namespace segsim::experiments::internal {
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

std::chrono::steady_clock::time_point later(double seconds) {
  using Clock = std::chrono::steady_clock;
  return Clock::now() + std::chrono::duration_cast<Clock::duration>(Seconds(seconds));
}

}  // namespace

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
    const Store store = Store::for_reading(file);
    std::vector<RunPointer> runs;
    for (const RunRow& row : store.runs()) {
      auto run = std::make_shared<RunSnapshot>();
      run->key =
          core::sha256_hex(file.string()).substr(0, 10) + "." + std::to_string(row.run_id);
      run->stored = {file.parent_path(), row, store.scenes(row.run_id), store.arms(row.run_id),
                     store.trials(row.run_id)};
      run->table = summarise(run->stored);
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

void RunIndex::refresh() {
  look_for_databases();
  for (auto& [file, database] : databases_) {
    if (Clock::now() < database.next) continue;
    if (database.stamp == stamp_of(file) && database.problem.empty()) continue;
    read(file, database);
  }
}

std::vector<RunPointer> RunIndex::runs() {
  const std::lock_guard<std::mutex> lock(mutex_);
  refresh();
  std::vector<RunPointer> all;
  for (const auto& [file, database] : databases_) {
    all.insert(all.end(), database.runs.begin(), database.runs.end());
  }
  std::stable_sort(all.begin(), all.end(), [](const RunPointer& a, const RunPointer& b) {
    return a->stored.run.started > b->stored.run.started;
  });
  return all;
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

}  // namespace segsim::experiments::internal
