// Trials in the store: adding and reading them.
#include <algorithm>
#include <filesystem>
#include <map>
#include <string>
#include <tuple>

#include "experiments/records/internal/sql_columns.h"
#include "experiments/records/internal/store_impl.h"

namespace segsim::experiments::records {
namespace {

constexpr const char* kRemoveFailed =
    "DELETE FROM trial WHERE run_id = ? AND arm = ? AND episode = ? AND repetition = ? AND "
    "outcome = 'error'";
/// Before the failed trial itself is removed.
constexpr const char* kRemoveAttributionOfFailed =
    "DELETE FROM attribution WHERE trial_id IN (SELECT trial_id FROM trial WHERE run_id = ? "
    "AND arm = ? AND episode = ? AND repetition = ? AND outcome = 'error')";

/// Position of each name in a list of rows.
template <class Row>
std::map<std::string, int> positions(const std::vector<Row>& rows) {
  std::map<std::string, int> by_name;
  for (const Row& row : rows) by_name.emplace(row.name, static_cast<int>(by_name.size()));
  return by_name;
}

/// A database from elsewhere must not make the program open other files.
/// @param place  Of the row, for the error message.
void check_files(const TrialRow& row, const std::string& place) {
  const auto check = [&](const char* column, const std::string& file) {
    const std::filesystem::path path = std::filesystem::path(file).lexically_normal();
    if (path.is_relative() && (path.empty() || *path.begin() != "..")) return;
    throw core::InputError::expected(place + column, "a file below the folder of the run",
                                     "\"" + file + "\"");
  };
  check("log", row.log);
  check("picture", row.picture);
  check("video", row.video);
  check("track", row.track);
}

int position_of(const std::map<std::string, int>& positions, const std::string& name) {
  const auto found = positions.find(name);
  return found == positions.end() ? -1 : found->second;
}

/// By scene, episode, repetition, arm; scenes and arms in the order of the run.
std::vector<TrialRow> sorted(std::vector<TrialRow> rows, const std::vector<SceneRow>& scenes,
                             const std::vector<ArmRow>& arms) {
  struct Key {
    int scene, arm;
    TrialRow* row;
  };
  const auto scene_positions = positions(scenes);
  const auto arm_positions = positions(arms);
  std::vector<Key> keys;
  keys.reserve(rows.size());
  for (TrialRow& row : rows) {
    keys.push_back(
        {position_of(scene_positions, row.scene), position_of(arm_positions, row.arm), &row});
  }
  std::sort(keys.begin(), keys.end(), [](const Key& a, const Key& b) {
    if (a.scene != b.scene) return a.scene < b.scene;
    if (const int order = a.row->episode.compare(b.row->episode); order != 0) return order < 0;
    return std::tie(a.row->repetition, a.arm, a.row->trial_id) <
           std::tie(b.row->repetition, b.arm, b.row->trial_id);
  });
  std::vector<TrialRow> ordered;
  ordered.reserve(rows.size());
  for (const Key& key : keys) ordered.push_back(std::move(*key.row));
  return ordered;
}

}  // namespace

void Store::Impl::choose_durability() {
  const Clock::time_point now = Clock::now();
  const bool due =
      !synced || std::chrono::duration<double>(now - *synced).count() >= kSyncPeriod_s;
  execute(due ? "PRAGMA synchronous = FULL" : "PRAGMA synchronous = NORMAL");
  if (due) synced = now;
}

void Store::Impl::put_trial(std::int64_t run_id, const TrialRow& t) {
  for (const char* sql : {kRemoveAttributionOfFailed, kRemoveFailed}) {
    prepared(sql).bind(run_id).bind(t.arm).bind(t.episode).bind(t.repetition).step();
  }
  TrialRow stamped = t;
  if (stamped.finished.empty()) stamped.finished = utc_now();
  static const std::string kInsertTrial = insert_columns<TrialRow>("trial", "run_id");
  insert_row(prepared(kInsertTrial.c_str()).bind(run_id), stamped);
  if (!t.why.known()) return;
  static const std::string kInsertWhy =
      insert_columns<TrialRow>("attribution", "trial_id", SqlTable::kAttribution);
  insert_row(prepared(kInsertWhy.c_str()).bind(std::int64_t{sqlite3_last_insert_rowid(db)}), t,
             SqlTable::kAttribution);
}

void Store::add_trial(std::int64_t run_id, const TrialRow& trial) {
  impl_->choose_durability();
  Impl::Transaction transaction(*impl_);
  impl_->put_trial(run_id, trial);
  transaction.commit();
}

void Store::add_trials(std::int64_t run_id, std::span<const TrialRow> trials) {
  impl_->execute("PRAGMA synchronous = FULL");
  Impl::Transaction transaction(*impl_);
  for (const TrialRow& trial : trials) impl_->put_trial(run_id, trial);
  transaction.commit();
}

std::vector<TrialRow> Store::trials(std::int64_t run_id) const {
  const std::string sql =
      select_columns<TrialRow>("trial_id") +
      " FROM trial LEFT JOIN attribution USING (trial_id) WHERE run_id = ?";
  Statement count(impl_->db, impl_->file, "SELECT COUNT(*) FROM trial WHERE run_id = ?");
  count.bind(run_id).step();
  std::vector<TrialRow> rows;
  rows.reserve(static_cast<std::size_t>(count.integer()));
  Statement select(impl_->db, impl_->file, sql.c_str());
  select.bind(run_id);
  while (select.step()) {
    const std::string place =
        impl_->file.string() + ": trial " + std::to_string(select.integer()) + ": ";
    rows.push_back(read_columns<TrialRow>(select, place));
    check_files(rows.back(), place);
  }
  return sorted(std::move(rows), scenes(run_id), arms(run_id));
}

std::vector<std::string> Store::finish_times(std::int64_t run_id, int count) const {
  Statement select(impl_->db, impl_->file,
                   "SELECT finished FROM trial WHERE run_id = ? "
                   "ORDER BY trial_id DESC LIMIT ?");
  select.bind(run_id).bind(count);
  std::vector<std::string> times;
  while (select.step()) times.push_back(select.text());
  return times;
}

}  // namespace segsim::experiments::records
