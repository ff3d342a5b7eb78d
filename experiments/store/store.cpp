#include "experiments/store/store.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <string_view>

#include <sqlite3.h>

#include "core/error.h"
#include "experiments/internal/formatted.h"
#include "experiments/store/internal/sqlite_statement.h"
#include "experiments/store/internal/store_attribution.h"
#include "experiments/store/internal/store_schema.h"

namespace segsim::experiments {
namespace {

/// Of an AP50 in the database.
constexpr double kNotMeasured = -1.0;

}  // namespace

struct Store::Impl {
  std::filesystem::path file;
  sqlite3* db = nullptr;

  ~Impl() { sqlite3_close(db); }

  void execute(const char* sql) const {
    if (sqlite3_exec(db, sql, nullptr, nullptr, nullptr) != SQLITE_OK) {
      throw core::InputError::expected(file.string(), "a working SQLite database",
                                       sqlite3_errmsg(db));
    }
  }

  /// The first column of the first row; `fallback` if there is no row.
  [[nodiscard]] std::int64_t query_integer(const char* sql, std::int64_t fallback) const {
    Statement statement(db, file, sql);
    return statement.step() ? statement.integer() : fallback;
  }

  /// Rolls back unless `commit` was called.
  class Transaction {
   public:
    explicit Transaction(const Impl& impl) : impl_(impl) { impl.execute("BEGIN IMMEDIATE"); }
    ~Transaction() {
      if (!done_) sqlite3_exec(impl_.db, "ROLLBACK", nullptr, nullptr, nullptr);
    }
    Transaction(const Transaction&) = delete;
    Transaction& operator=(const Transaction&) = delete;
    void commit() {
      impl_.execute("COMMIT");
      done_ = true;
    }

   private:
    const Impl& impl_;
    bool done_ = false;
  };

  void create_or_check_schema() const {
    const Impl& self = *this;
    Transaction transaction(self);
    if (query_integer("SELECT COUNT(*) FROM sqlite_master WHERE name = 'meta'", 0) == 0) {
      if (query_integer("SELECT COUNT(*) FROM sqlite_master", 0) != 0) {
        throw core::InputError::expected(file.string(), "a results database of segsim",
                                         "another SQLite database");
      }
      execute(kSchema);
      execute(kAttributionSchema);
      execute(kImagesColumn);
      Statement insert(db, file, "INSERT INTO meta VALUES (?, ?)");
      const std::string now = utc_now();
      insert.bind(kSchemaVersion).bind(now).step();
    } else {
      const auto version = [&] {
        return query_integer("SELECT schema_version FROM meta", -1);
      };
      if (version() == kBeforeHeldOut) execute(kHeldOutMigration);
      if (version() == kBeforeAttribution) {
        execute(kAttributionSchema);
        execute(kAttributionMigration);
      }
      if (version() == kBeforeTuningCost) execute(kTuningCostMigration);
      if (version() == kBeforeImages) {
        execute(kImagesColumn);
        execute("UPDATE meta SET schema_version = 5;");
      }
      const std::int64_t found = version();
      if (found != kSchemaVersion) {
        throw core::InputError::expected(file.string(),
                                         "schema version " + std::to_string(kSchemaVersion),
                                         "version " + std::to_string(found) +
                                             " (keep it for that program version, or give "
                                             "another --work folder)");
      }
    }
    transaction.commit();
  }
};

Store::Store(const std::filesystem::path& file) : impl_(std::make_unique<Impl>()) {
  impl_->file = file;
  if (file.has_parent_path()) {
    std::error_code ignored;  // Opening the file reports it.
    std::filesystem::create_directories(file.parent_path(), ignored);
  }
  if (sqlite3_open(file.c_str(), &impl_->db) != SQLITE_OK) {
    throw core::InputError::expected(file.string(), "a place for a SQLite database",
                                     sqlite3_errmsg(impl_->db));
  }
  sqlite3_busy_timeout(impl_->db, 10000);
  impl_->execute("PRAGMA journal_mode = WAL");
  impl_->execute("PRAGMA synchronous = FULL");
  impl_->execute("PRAGMA foreign_keys = ON");
  impl_->create_or_check_schema();
}

Store::Store(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

Store Store::for_reading(const std::filesystem::path& file) {
  auto impl = std::make_unique<Impl>();
  impl->file = file;
  if (sqlite3_open_v2(file.c_str(), &impl->db, SQLITE_OPEN_READONLY, nullptr) != SQLITE_OK) {
    throw core::InputError::expected(file.string(), "a results database",
                                     sqlite3_errmsg(impl->db));
  }
  sqlite3_busy_timeout(impl->db, 2000);
  impl->execute("BEGIN");  // All that follows sees one state.
  if (impl->query_integer("SELECT COUNT(*) FROM sqlite_master WHERE name = 'meta'", 0) == 0) {
    throw core::InputError::expected(file.string(), "a results database of segsim",
                                     "another SQLite database");
  }
  const std::int64_t found = impl->query_integer("SELECT schema_version FROM meta", -1);
  if (found != kSchemaVersion) {
    throw core::InputError::expected(
        file.string(), "schema version " + std::to_string(kSchemaVersion),
        "version " + std::to_string(found) +
            (found < kSchemaVersion ? " (`segsim table` brings it up to date)" : ""));
  }
  return Store(std::move(impl));
}

Store::~Store() = default;

std::int64_t Store::begin_run(const RunRow& run, const std::vector<SceneRow>& scene_rows,
                              const std::vector<ArmRow>& arm_rows) {
  Impl::Transaction transaction(*impl_);
  const std::string now = utc_now();
  Statement insert(
      impl_->db, impl_->file,
      "INSERT INTO run (name, title, spec_sha256, spec_text, code_version, host, "
      "libraries, success_profile, seed, planned_n, planned_trials, started, ended) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, '')");
  insert.bind(run.name).bind(run.title).bind(run.spec_sha256).bind(run.spec_text);
  insert.bind(run.code_version).bind(run.host).bind(run.libraries).bind(run.success_profile);
  insert.bind(static_cast<std::int64_t>(run.seed))
      .bind(run.planned_n)
      .bind(run.planned_trials);
  insert.bind(now).step();
  const std::int64_t run_id = sqlite3_last_insert_rowid(impl_->db);

  int position = 0;
  for (const SceneRow& scene : scene_rows) {
    Statement row(impl_->db, impl_->file,
                  "INSERT INTO scene VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)");
    row.bind(run_id).bind(position++).bind(scene.name).bind(scene.title);
    row.bind(scene.scene_sha256).bind(scene.episodes_sha256).bind(scene.episodes);
    row.bind(scene.oracle_successes).bind(scene.oracle_episodes).step();
  }
  position = 0;
  for (const ArmRow& arm : arm_rows) {
    Statement row(impl_->db, impl_->file,
                  "INSERT INTO arm VALUES ("
                  "?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
    row.bind(run_id).bind(position++).bind(arm.name).bind(arm.detector);
    row.bind(arm.weights_sha256).bind(arm.tuned_on).bind(arm.score_threshold);
    const HeldOutPrecision held_out = arm.held_out.value_or(HeldOutPrecision{});
    row.bind(held_out.views).bind(held_out.ap50).bind(held_out.ap);
    row.bind(held_out.score_threshold).bind(held_out.precision).bind(held_out.recall);
    row.bind(held_out.source_ap50.value_or(kNotMeasured));
    row.bind(held_out.unseen_ap50.value_or(kNotMeasured));
    const StartLeak leak = arm.start_leak.value_or(StartLeak{});
    row.bind(leak.views).bind(leak.near_starts).bind(leak.radius_m).step();
  }
  transaction.commit();
  return run_id;
}

void Store::end_run(std::int64_t run_id) {
  const std::string now = utc_now();
  Statement update(impl_->db, impl_->file, "UPDATE run SET ended = ? WHERE run_id = ?");
  update.bind(now).bind(run_id).step();
}

std::vector<RunRow> Store::runs() const {
  Statement select(
      impl_->db, impl_->file,
      "SELECT run_id, name, title, spec_sha256, spec_text, code_version, host, "
      "libraries, success_profile, seed, planned_n, planned_trials, started, ended "
      "FROM run ORDER BY run_id");
  std::vector<RunRow> rows;
  while (select.step()) {
    RunRow run;
    run.run_id = select.integer();
    for (std::string* column :
         {&run.name, &run.title, &run.spec_sha256, &run.spec_text, &run.code_version,
          &run.host, &run.libraries, &run.success_profile}) {
      *column = select.text();
    }
    run.seed = static_cast<std::uint64_t>(select.integer());
    run.planned_n = select.small_integer();
    run.planned_trials = select.small_integer();
    run.started = select.text();
    run.ended = select.text();
    rows.push_back(std::move(run));
  }
  return rows;
}

std::vector<SceneRow> Store::scenes(std::int64_t run_id) const {
  Statement select(impl_->db, impl_->file,
                   "SELECT name, title, scene_sha256, episodes_sha256, episodes, "
                   "oracle_successes, oracle_episodes FROM scene "
                   "WHERE run_id = ? ORDER BY position");
  select.bind(run_id);
  std::vector<SceneRow> rows;
  while (select.step()) {
    SceneRow scene;
    for (std::string* column :
         {&scene.name, &scene.title, &scene.scene_sha256, &scene.episodes_sha256}) {
      *column = select.text();
    }
    scene.episodes = select.integer();
    scene.oracle_successes = select.small_integer();
    scene.oracle_episodes = select.small_integer();
    rows.push_back(std::move(scene));
  }
  return rows;
}

std::vector<ArmRow> Store::arms(std::int64_t run_id) const {
  Statement select(
      impl_->db, impl_->file,
      "SELECT name, detector, weights_sha256, tuned_on, score_threshold, "
      "held_out_views, ap50, ap, held_out_threshold, precision, recall, source_ap50, "
      "unseen_ap50, tuning_views, tuning_views_near_starts, start_radius_m FROM arm "
      "WHERE run_id = ? ORDER BY position");
  select.bind(run_id);
  std::vector<ArmRow> rows;
  while (select.step()) {
    ArmRow arm;
    for (std::string* column :
         {&arm.name, &arm.detector, &arm.weights_sha256, &arm.tuned_on}) {
      *column = select.text();
    }
    arm.score_threshold = select.number();
    HeldOutPrecision held_out;
    held_out.views = select.small_integer();
    for (double* column : {&held_out.ap50, &held_out.ap, &held_out.score_threshold,
                           &held_out.precision, &held_out.recall}) {
      *column = select.number();
    }
    for (std::optional<double>* column : {&held_out.source_ap50, &held_out.unseen_ap50}) {
      const double value = select.number();
      if (value > kNotMeasured) *column = value;
    }
    if (held_out.views > 0) arm.held_out = held_out;
    StartLeak leak;
    leak.views = select.small_integer();
    leak.near_starts = select.small_integer();
    leak.radius_m = select.number();
    if (leak.views > 0) arm.start_leak = leak;
    rows.push_back(std::move(arm));
  }
  return rows;
}

void Store::add_trial(std::int64_t run_id, const TrialRow& t) {
  Impl::Transaction transaction(*impl_);
  remove_attribution_of_failed(impl_->db, impl_->file, run_id, t);
  Statement remove_failed(impl_->db, impl_->file,
                          "DELETE FROM trial WHERE run_id = ? AND arm = ? AND episode = ? AND "
                          "repetition = ? AND outcome = 'error'");
  remove_failed.bind(run_id).bind(t.arm).bind(t.episode).bind(t.repetition).step();

  Statement insert(
      impl_->db, impl_->file,
      "INSERT INTO trial (run_id, arm, scene, episode, goal_class, repetition, outcome, "
      "success, stop_reason, spl, soft_spl, path_m, shortest_path_m, distance_to_goal_m, "
      "sim_s, wall_s, ticks, contacts, contact_s, first_visible_tick, first_detected_tick, "
      "invalid_pixel_fraction, state_hash, render_ms, detect_ms, policy_ms, error, picture, "
      "video, track, finished) VALUES "
      "(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, "
      "?, ?, ?, ?, ?, ?, ?, ?, ?, ?, "
      "?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  const std::string hash = hex(t.state_hash), now = utc_now();
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
  insert.bind(t.picture).bind(t.video).bind(t.track).bind(now);
  insert.step();
  insert_attribution(impl_->db, impl_->file, sqlite3_last_insert_rowid(impl_->db), t);
  transaction.commit();
}

std::vector<TrialRow> Store::trials(std::int64_t run_id) const {
  Statement select(
      impl_->db, impl_->file,
      "SELECT trial_id, trial.arm, trial.scene, episode, goal_class, repetition, outcome, "
      "success, "
      "stop_reason, spl, soft_spl, path_m, shortest_path_m, distance_to_goal_m, sim_s, "
      "wall_s, "
      "ticks, contacts, contact_s, first_visible_tick, first_detected_tick, "
      "invalid_pixel_fraction, state_hash, render_ms, detect_ms, policy_ms, error, picture, "
      "video, track FROM trial "
      "LEFT JOIN scene ON scene.run_id = trial.run_id AND scene.name = trial.scene "
      "LEFT JOIN arm ON arm.run_id = trial.run_id AND arm.name = trial.arm "
      "WHERE trial.run_id = ? ORDER BY scene.position, episode, repetition, arm.position");
  select.bind(run_id);
  std::vector<TrialRow> rows;
  while (select.step()) {
    TrialRow t;
    t.trial_id = select.integer();
    for (std::string* column : {&t.arm, &t.scene, &t.episode, &t.goal_class}) {
      *column = select.text();
    }
    t.repetition = select.small_integer();
    t.outcome = select.text();
    t.success = select.integer() != 0;
    t.stop_reason = select.text();
    for (double* column : {&t.spl, &t.soft_spl, &t.path_m, &t.shortest_path_m}) {
      *column = select.number();
    }
    t.distance_to_goal_m = select.optional_number();
    t.sim_s = select.number();
    t.wall_s = select.number();
    t.ticks = select.small_integer();
    t.contacts = select.small_integer();
    t.contact_s = select.number();
    t.first_visible_tick = select.small_integer();
    t.first_detected_tick = select.small_integer();
    t.invalid_pixel_fraction = select.number();
    t.state_hash = std::stoull(select.text(), nullptr, 16);
    for (double* column : {&t.render_ms, &t.detect_ms, &t.policy_ms})
      *column = select.number();
    for (std::string* column : {&t.error, &t.picture, &t.video, &t.track}) {
      *column = select.text();
    }
    rows.push_back(std::move(t));
  }
  read_attributions(impl_->db, impl_->file, run_id, rows);
  return rows;
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

std::string utc_now() {
  const std::time_t now =
      std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm parts{};
  gmtime_r(&now, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text;
}

}  // namespace segsim::experiments
