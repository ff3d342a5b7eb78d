// Trials in the store: adding and reading them.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>
#include <tuple>

#include "experiments/records/internal/store_attribution.h"
#include "experiments/records/internal/store_impl.h"
#include "experiments/records/row_names.h"
#include "experiments/support/formatted.h"

namespace segsim::experiments {
namespace {

constexpr const char* kRemoveFailed =
    "DELETE FROM trial WHERE run_id = ? AND arm = ? AND episode = ? AND repetition = ? AND "
    "outcome = 'error'";
constexpr const char* kInsertTrial =
    "INSERT INTO trial (run_id, arm, scene, episode, goal_class, repetition, outcome, "
    "success, stop_reason, spl, soft_spl, path_m, shortest_path_m, distance_to_goal_m, "
    "sim_s, wall_s, ticks, contacts, contact_s, first_visible_tick, first_detected_tick, "
    "invalid_pixel_fraction, state_hash, render_ms, detect_ms, policy_ms, error, picture, "
    "video, track, finished) VALUES "
    "(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, "
    "?, ?, ?, ?, ?, ?, ?, ?, ?, ?, "
    "?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)";

std::uint64_t hash_from(std::string_view hexadecimal) {
  std::uint64_t hash = 0;
  std::from_chars(hexadecimal.data(), hexadecimal.data() + hexadecimal.size(), hash, 16);
  return hash;
}

/// The columns of the table `trial` but run_id, and why it failed.
TrialRow read_trial(Statement& row) {
  TrialRow t;
  t.trial_id = row.integer();
  for (std::string* column : {&t.arm, &t.scene, &t.episode, &t.goal_class}) {
    *column = row.text();
  }
  t.repetition = row.small_integer();
  t.outcome = row.text();
  t.success = row.integer() != 0;
  t.stop_reason = row.text();
  for (double* column : {&t.spl, &t.soft_spl, &t.path_m, &t.shortest_path_m}) {
    *column = row.number();
  }
  t.distance_to_goal_m = row.optional_number();
  t.sim_s = row.number();
  t.wall_s = row.number();
  t.ticks = row.small_integer();
  t.contacts = row.small_integer();
  t.contact_s = row.number();
  t.first_visible_tick = row.small_integer();
  t.first_detected_tick = row.small_integer();
  t.invalid_pixel_fraction = row.number();
  t.state_hash = hash_from(row.text_view());
  for (double* column : {&t.render_ms, &t.detect_ms, &t.policy_ms}) *column = row.number();
  for (std::string* column : {&t.error, &t.picture, &t.video, &t.track, &t.finished}) {
    *column = row.text();
  }
  read_attribution(row, t);
  return t;
}

/// Position of each name in a list of rows.
template <class Row>
std::map<std::string, int> positions(const std::vector<Row>& rows) {
  std::map<std::string, int> by_name;
  for (const Row& row : rows) by_name.emplace(row.name, static_cast<int>(by_name.size()));
  return by_name;
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
  Statement& insert = prepared(kInsertTrial);
  const std::string hash = hex(t.state_hash);
  const std::string finished = t.finished.empty() ? utc_now() : t.finished;
  insert.bind(run_id).bind(t.arm).bind(t.scene).bind(t.episode).bind(t.goal_class);
  insert.bind(t.repetition).bind(t.outcome).bind(t.success ? 1 : 0).bind(t.stop_reason);
  insert.bind(t.spl).bind(t.soft_spl).bind(t.path_m).bind(t.shortest_path_m);
  if (t.distance_to_goal_m && std::isfinite(*t.distance_to_goal_m)) {
    insert.bind(*t.distance_to_goal_m);
  } else {
    insert.bind_null();
  }
  insert.bind(t.sim_s).bind(t.wall_s).bind(t.ticks).bind(t.contacts).bind(t.contact_s);
  insert.bind(t.first_visible_tick).bind(t.first_detected_tick).bind(t.invalid_pixel_fraction);
  insert.bind(hash).bind(t.render_ms).bind(t.detect_ms).bind(t.policy_ms).bind(t.error);
  insert.bind(t.picture).bind(t.video).bind(t.track).bind(finished);
  insert.step();
  if (!t.why.known()) return;
  insert_attribution(prepared(kInsertAttribution), sqlite3_last_insert_rowid(db), t);
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
      "SELECT trial.trial_id, arm, scene, episode, goal_class, repetition, outcome, success, "
      "stop_reason, spl, soft_spl, path_m, shortest_path_m, distance_to_goal_m, sim_s, "
      "wall_s, ticks, contacts, contact_s, first_visible_tick, first_detected_tick, "
      "invalid_pixel_fraction, state_hash, render_ms, detect_ms, policy_ms, error, picture, "
      "video, track, finished, " +
      std::string(kAttributionColumns) +
      " FROM trial LEFT JOIN attribution USING (trial_id) WHERE run_id = ?";
  Statement count(impl_->db, impl_->file, "SELECT COUNT(*) FROM trial WHERE run_id = ?");
  count.bind(run_id).step();
  std::vector<TrialRow> rows;
  rows.reserve(static_cast<std::size_t>(count.integer()));
  Statement select(impl_->db, impl_->file, sql.c_str());
  select.bind(run_id);
  while (select.step()) {
    rows.push_back(read_trial(select));
    check_names(rows.back(), impl_->file.string());
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

}  // namespace segsim::experiments
