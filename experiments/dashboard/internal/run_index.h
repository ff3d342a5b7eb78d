#pragma once

/// @file
/// The runs below some folders, read again when their databases change. The parts of a run
/// that lie in WORK/shards/NAME (docs/scale_out.md) are shown as one run of WORK.

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "experiments/results/stored_run.h"
#include "experiments/results/table.h"

namespace segsim::experiments::dashboard::internal {

/// One run at one moment; never changed once made.
struct RunSnapshot {
  std::string key;  ///< Of its addresses: letters, digits and one dot.
  results::StoredRun stored;
  results::ResultTable table;
  /// When the newest trials finished, newest first.
  std::vector<std::string> finish_times;
  /// Where its workers may show themselves (live_files.h).
  std::vector<std::filesystem::path> live_folders;
};
using RunPointer = std::shared_ptr<const RunSnapshot>;

/// The parts of one run as one: trials of the same arm, episode and repetition count once,
/// finished ones before failed ones, those of shards before those of `merged`. Trials have new
/// numbers. @param merged  Of the work folder itself; may be null.
/// @param shards  At least one.
[[nodiscard]] RunPointer combined_run(const std::filesystem::path& work,
                                      const RunPointer& merged,
                                      const std::vector<RunPointer>& shards);

class RunIndex {
 public:
  /// @throws core::InputError if one of them is not there.
  explicit RunIndex(std::vector<std::filesystem::path> roots);

  /// All runs, newest first. A database that changed is read again at most four times a
  /// second, and in at most a twentieth of the time.
  [[nodiscard]] std::vector<RunPointer> runs();
  /// nullptr for an unknown key.
  [[nodiscard]] RunPointer find(const std::string& key);
  /// Databases that could not be read, and why.
  [[nodiscard]] std::vector<std::string> problems();

 private:
  using Clock = std::chrono::steady_clock;
  struct Database {
    std::string stamp;  ///< Of the files at the last reading.
    Clock::time_point next;
    std::vector<RunPointer> runs;
    std::string problem;
  };
  void refresh();
  void look_for_databases();
  static void read(const std::filesystem::path& file, Database& database);
  void combine();

  std::vector<std::filesystem::path> roots_;
  std::mutex mutex_;  // Guards what follows.
  std::map<std::filesystem::path, Database> databases_;
  std::vector<RunPointer> shown_;  ///< Of all databases, shards combined; newest first.
  Clock::time_point next_look_;
};

}  // namespace segsim::experiments::dashboard::internal
