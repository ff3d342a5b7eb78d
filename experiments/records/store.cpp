#include "experiments/records/store.h"

#include <chrono>
#include <cmath>
#include <ctime>

#include <sqlite3.h>

#include "core/error.h"
#include "experiments/records/internal/arm_columns.h"
#include "experiments/records/internal/sql_columns.h"
#include "experiments/records/internal/store_impl.h"
#include "experiments/records/internal/store_schema.h"

namespace segsim::experiments::records {
namespace {

/// Of the provenance in which an arm's exposure is kept.
std::string exposure_key(const ArmRow& arm) { return "leakage/" + arm.name; }

}  // namespace

void Store::Impl::create_or_check_schema() const {
  const Impl& self = *this;
  Transaction transaction(self);
  if (query_integer("SELECT COUNT(*) FROM sqlite_master WHERE name = 'meta'", 0) == 0) {
    create_schema();
  } else {
    migrate();
  }
  transaction.commit();
}

/// SQLite reads a file that was cut short or has flipped bits as far as it can, and leaves out
/// what it does not find: rows would be missing from a table without a word.
void Store::Impl::check_integrity() const {
  Statement check(db, file, "PRAGMA quick_check(1)");
  const std::string found = check.step() ? check.text() : "no answer";
  if (found == "ok") return;
  throw core::InputError::expected(
      file.string(),
      "an undamaged results database (`segsim merge` makes it anew from shards)", found);
}

void Store::Impl::create_schema() const {
  if (query_integer("SELECT COUNT(*) FROM sqlite_master", 0) != 0) {
    throw core::InputError::expected(file.string(), "a results database of segsim",
                                     "another SQLite database");
  }
  execute(present_schema().c_str());
  Statement insert(db, file, "INSERT INTO meta VALUES (?, ?)");
  const std::string now = utc_now();
  insert.bind(kSchemaVersion).bind(now).step();
}

void Store::Impl::migrate() const {
  std::int64_t version = query_integer("SELECT schema_version FROM meta", -1);
  for (const Migration& migration : migrations()) {
    if (version != migration.to - 1) continue;
    execute(migration.sql);
    version = migration.to;
    Statement update(db, file, "UPDATE meta SET schema_version = ?");
    update.bind(version).step();
  }
  if (version == kSchemaVersion) return;
  throw core::InputError::expected(
      file.string(), "schema version " + std::to_string(kSchemaVersion),
      "version " + std::to_string(version) +
          " (keep it for that program version, or give another --work folder)");
}

Store::Store(const std::filesystem::path& file) : impl_(std::make_unique<Impl>()) {
  impl_->file = file;
  if (file.has_parent_path()) {
    std::error_code ignored;  // Opening the file reports it.
    std::filesystem::create_directories(file.parent_path(), ignored);
  }
  const int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX;
  if (sqlite3_open_v2(file.c_str(), &impl_->db, flags, nullptr) != SQLITE_OK) {
    throw sqlite_error(impl_->db, file);
  }
  sqlite3_busy_timeout(impl_->db, 10000);
  impl_->check_integrity();
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
  RunRow begun = run;
  begun.started = utc_now();
  begun.ended.clear();
  static const std::string kInsertRun = insert_columns<RunRow>("run", "");
  insert_row(impl_->prepared(kInsertRun.c_str()), begun);
  const std::int64_t run_id = sqlite3_last_insert_rowid(impl_->db);

  int position = 0;
  static const std::string kInsertScene =
      insert_columns<SceneRow>("scene", "run_id, position");
  for (SceneRow scene : scene_rows) {
    scene.family = family_of(scene);
    Statement& insert = impl_->prepared(kInsertScene.c_str());
    insert_row(insert.bind(run_id).bind(position++), scene);
  }
  position = 0;
  static const std::string kInsertArm = insert_columns<ArmColumns>("arm", "run_id, position");
  for (const ArmRow& arm : arm_rows) {
    Statement& insert = impl_->prepared(kInsertArm.c_str());
    insert_row(insert.bind(run_id).bind(position++), columns_of(arm));
  }
  for (const auto& [name, value] : run.provenance) impl_->put_provenance(run_id, name, value);
  for (const ArmRow& arm : arm_rows) {
    if (!arm.exposure) continue;
    impl_->put_provenance(run_id, exposure_key(arm), exposure_text(*arm.exposure));
  }
  transaction.commit();
  return run_id;
}

void Store::Impl::put_provenance(std::int64_t run_id, const std::string& name,
                                 const std::string& value) {
  Statement& insert = prepared("INSERT OR REPLACE INTO provenance VALUES (?, ?, ?)");
  insert.bind(run_id).bind(name).bind(value).step();
}

void Store::set_provenance(std::int64_t run_id, const std::string& name,
                           const std::string& value) {
  impl_->put_provenance(run_id, name, value);
}

void Store::end_run(std::int64_t run_id) {
  const std::string now = utc_now();
  Statement update(impl_->db, impl_->file, "UPDATE run SET ended = ? WHERE run_id = ?");
  update.bind(now).bind(run_id).step();
}

std::vector<RunRow> Store::runs() const {
  const std::string sql = select_columns<RunRow>() + " FROM run ORDER BY run_id";
  Statement select(impl_->db, impl_->file, sql.c_str());
  std::vector<RunRow> rows;
  while (select.step()) rows.push_back(read_columns<RunRow>(select));
  Statement provenance(impl_->db, impl_->file,
                       "SELECT name, value FROM provenance WHERE run_id = ?");
  for (RunRow& run : rows) {
    provenance.reset().bind(run.run_id);
    while (provenance.step()) {
      std::string name = provenance.text();
      run.provenance[std::move(name)] = provenance.text();
    }
  }
  return rows;
}

std::vector<SceneRow> Store::scenes(std::int64_t run_id) const {
  const std::string sql =
      select_columns<SceneRow>() + " FROM scene WHERE run_id = ? ORDER BY position";
  Statement select(impl_->db, impl_->file, sql.c_str());
  select.bind(run_id);
  std::vector<SceneRow> rows;
  while (select.step()) rows.push_back(read_columns<SceneRow>(select));
  return rows;
}

std::vector<ArmRow> Store::arms(std::int64_t run_id) const {
  const std::string sql =
      select_columns<ArmColumns>() + " FROM arm WHERE run_id = ? ORDER BY position";
  Statement select(impl_->db, impl_->file, sql.c_str());
  select.bind(run_id);
  std::vector<ArmRow> rows;
  while (select.step()) rows.push_back(arm_of(read_columns<ArmColumns>(select)));
  Statement exposure(impl_->db, impl_->file,
                     "SELECT value FROM provenance WHERE run_id = ? AND name = ?");
  for (ArmRow& arm : rows) {
    const std::string key = exposure_key(arm);
    exposure.reset().bind(run_id).bind(key);
    if (exposure.step()) arm.exposure = parse_exposure(exposure.text());
  }
  return rows;
}

namespace {

/// Seconds since the machine was started, also while it slept.
double uptime_s() {
  timespec time{};
  ::clock_gettime(CLOCK_BOOTTIME, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace

std::string utc_now() {
  // Read once: when the clock is set, times of one run must not go backwards or leave a gap.
  static const auto begin = std::chrono::system_clock::now();
  static const double begin_s = uptime_s();
  const std::time_t now = std::chrono::system_clock::to_time_t(begin) +
                          static_cast<std::time_t>(std::llround(uptime_s() - begin_s));
  std::tm parts{};
  gmtime_r(&now, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text;
}

}  // namespace segsim::experiments::records
