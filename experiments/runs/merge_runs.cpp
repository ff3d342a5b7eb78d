#include "experiments/runs/merge_runs.h"

#include <algorithm>
#include <array>
#include <map>
#include <string_view>
#include <tuple>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "experiments/records/results_digest.h"
#include "experiments/results/stored_run.h"
#include "experiments/runs/run.h"
#include "experiments/runs/run_provenance.h"
#include "experiments/support/folder_lock.h"

namespace segsim::experiments::runs {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDatabase = "results.sqlite";

void expect_equal(const fs::path& place, const std::string& what, const std::string& expected,
                  const std::string& found) {
  if (expected == found) return;
  throw core::InputError::expected(place.string(), what + " " + expected, found);
}

/// Refuses what would not compare: parts of one run have the same inputs.
void check_same_run(const results::StoredRun& a, const results::StoredRun& b) {
  expect_equal(b.folder, "the spec of " + a.folder.string() + ", SHA-256", a.run.spec_sha256,
               b.run.spec_sha256);
  expect_equal(b.folder, "segsim", a.run.code_version, b.run.code_version);
  expect_equal(b.folder, "planned trials:", std::to_string(a.run.planned_trials),
               std::to_string(b.run.planned_trials));
  expect_equal(b.folder, "scenes:", std::to_string(a.scenes.size()),
               std::to_string(b.scenes.size()));
  expect_equal(b.folder, "arms:", std::to_string(a.arms.size()),
               std::to_string(b.arms.size()));
  check_same_programs(a.run.provenance, b.run.provenance);
  for (std::size_t i = 0; i < a.scenes.size(); ++i) {
    const records::SceneRow &x = a.scenes[i], &y = b.scenes[i];
    expect_equal(b.folder, "scene " + x.name + ", SHA-256", x.scene_sha256, y.scene_sha256);
    expect_equal(b.folder, "episodes of scene " + x.name + ", SHA-256", x.episodes_sha256,
                 y.episodes_sha256);
  }
  for (std::size_t i = 0; i < a.arms.size(); ++i) {
    const records::ArmRow &x = a.arms[i], &y = b.arms[i];
    expect_equal(b.folder, "weights of arm " + x.name + ", SHA-256", x.weights_sha256,
                 y.weights_sha256);
  }
}

using TrialKey = std::tuple<std::string, std::string, int>;
TrialKey key_of(const records::TrialRow& t) { return {t.episode, t.arm, t.repetition}; }

/// Trials by name: those that were there, and those that come in.
class Trials {
 public:
  explicit Trials(const std::vector<records::TrialRow>& present) {
    for (const records::TrialRow& trial : present) by_key_[key_of(trial)] = {trial, false};
  }

  void add(const records::TrialRow& trial, const fs::path& from, MergeReport& report) {
    report.failed += trial.failed() ? 1 : 0;
    const auto [found, is_new] = by_key_.try_emplace(key_of(trial), Entry{trial, true});
    if (is_new) return;
    Entry& entry = found->second;
    if (trial.failed()) return;
    if (entry.trial.failed()) {
      entry = {trial, true};
      return;
    }
    if (records::essence_of(entry.trial) != records::essence_of(trial)) {
      throw core::InputError::expected(
          from.string() + ": trial " + trial.episode + " of arm " + trial.arm +
              ", repetition " + std::to_string(trial.repetition),
          std::string("what another store has (") + to_string(entry.trial.outcome) +
              ", hash " + core::hex(entry.trial.state_hash) + ")",
          std::string(to_string(trial.outcome)) + ", hash " + core::hex(trial.state_hash));
    }
    ++report.known;
  }

  /// In the order of their names, whatever the order of the shards.
  [[nodiscard]] std::vector<records::TrialRow> incoming() const {
    std::vector<records::TrialRow> rows;
    for (const auto& [key, entry] : by_key_) {
      if (entry.incoming) rows.push_back(entry.trial);
    }
    return rows;
  }

 private:
  struct Entry {
    records::TrialRow trial;
    bool incoming = false;
  };
  std::map<TrialKey, Entry> by_key_;
};

/// Whether it is a file of a trial, and not of the folder, its database, or a killed process.
bool is_of_a_trial(const fs::path& relative) {
  constexpr std::array<std::string_view, 7> kFolders{"pictures", "tracks",  "logs",   "videos",
                                                     "frames",   "sensors", "replays"};
  const std::string folder = relative.begin()->string();
  return std::find(kFolders.begin(), kFolders.end(), folder) != kFolders.end() &&
         relative.filename().string().front() != '.';
}

/// A second name for the file, or a copy where the file system has none.
void link_file(const fs::path& from, const fs::path& to) {
  std::error_code code;
  if (fs::equivalent(from, to, code)) return;
  const bool same_size = fs::exists(to) && fs::file_size(to) == fs::file_size(from);
  if (same_size && fs::last_write_time(to) == fs::last_write_time(from)) return;
  core::write_via_temporary(to, [&](const fs::path& temporary) {
    fs::remove(temporary);
    fs::create_hard_link(from, temporary, code);
    if (!code) return;
    fs::copy_file(from, temporary);
    fs::last_write_time(temporary, fs::last_write_time(from));
  });
}

void link_files(const fs::path& from, const fs::path& to) {
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(from)) {
    const fs::path relative = entry.path().lexically_relative(from);
    if (entry.is_regular_file() && is_of_a_trial(relative)) {
      link_file(entry.path(), to / relative);
    }
  }
}

/// "host-7, Xeon: 25 trials, 2026-01-01T00:00:00Z to 2026-01-01T01:00:00Z"
std::string in_words(const results::StoredRun& shard) {
  std::string last = shard.run.started;
  for (const records::TrialRow& trial : shard.trials) last = std::max(last, trial.finished);
  return shard.run.host + ": " + std::to_string(shard.trials.size()) + " trials, " +
         shard.run.started + " to " + last;
}

std::string name_of(const results::StoredRun& shard) {
  const auto found = shard.run.provenance.find("shard");
  return found != shard.run.provenance.end() ? found->second
                                             : shard.folder.filename().string();
}

/// The last run of `out`; what begins there is like the first shard but for its trials.
results::StoredRun target_run(records::Store& store, const fs::path& out,
                              const results::StoredRun& first) {
  if (store.runs().empty()) {
    records::RunRow run = first.run;
    run.provenance.erase("shard");  // And what else is a part's own.
    std::erase_if(run.provenance,
                  [](const auto& row) { return row.first.rfind("time/", 0) == 0; });
    store.begin_run(run, first.scenes, first.arms);
  }
  return results::load_run(out);
}

}  // namespace

std::vector<fs::path> shard_folders(const fs::path& work) {
  std::vector<fs::path> folders;
  std::error_code none;
  for (const fs::directory_entry& entry : fs::directory_iterator(work / "shards", none)) {
    if (fs::exists(entry.path() / kDatabase)) folders.push_back(entry.path());
  }
  std::sort(folders.begin(), folders.end());
  return folders;
}

MergeReport merge_runs(const fs::path& out, std::span<const fs::path> shards) {
  std::vector<results::StoredRun> parts;
  for (const fs::path& shard : shards) {
    parts.push_back(results::load_run(shard));
    check_same_run(parts.front(), parts.back());
  }
  if (parts.empty()) {
    throw core::InputError::expected(out.string(), "shards to merge", "none");
  }
  // Workers may still be at it, but not a run of the whole.
  const support::FolderLock lock(out, support::FolderLock::Kind::kShared,
                                 support::FolderLock::IfTaken::kRefuse);
  const fs::path file = out / kDatabase;
  MergeReport report;
  if (fs::exists(file)) {
    const records::Store store(file);
    if (!store.runs().empty()) check_same_run(results::load_run(out), parts.front());
  }
  records::Store store(file);
  const results::StoredRun target = target_run(store, out, parts.front());
  report.run_id = target.run.run_id;
  Trials trials(target.trials);
  for (const results::StoredRun& part : parts) {
    for (const records::TrialRow& trial : part.trials) trials.add(trial, part.folder, report);
  }

  // Files first: a trial that is in has its files.
  for (const results::StoredRun& part : parts) {
    std::error_code code;
    if (!fs::equivalent(part.folder, out, code)) link_files(part.folder, out);
  }
  const std::vector<records::TrialRow> incoming = trials.incoming();
  report.added = static_cast<int>(incoming.size());
  store.add_trials(report.run_id, incoming);
  for (const results::StoredRun& part : parts) {
    store.set_provenance(report.run_id, "merged/" + name_of(part), in_words(part));
  }

  results::StoredRun merged = results::load_run(out);
  const auto finished = std::count_if(merged.trials.begin(), merged.trials.end(),
                                      [](const records::TrialRow& t) { return !t.failed(); });
  if (finished == merged.run.planned_trials && merged.run.ended.empty()) {
    store.end_run(report.run_id);
    merged = results::load_run(out);
  }
  report.results_sha256 = records::results_sha256(merged.trials);
  report.table = results::summarise(merged);
  write_tables(out, report.table, merged.trials);
  return report;
}

}  // namespace segsim::experiments::runs
