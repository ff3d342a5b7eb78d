#include "experiments/records/store.h"

#include <chrono>
#include <ctime>

#include <sqlite3.h>

#include "core/error.h"
#include "experiments/records/internal/store_attribution.h"
#include "experiments/records/internal/store_impl.h"
#include "experiments/records/internal/store_schema.h"

namespace segsim::experiments {
namespace {

/// Of an AP50 in the database.
constexpr double kNotMeasured = -1.0;
/// Of the seed of an arm that was not fine-tuned.
constexpr std::int64_t kNoSeed = -1;

/// Of the provenance in which an arm's exposure is kept.
std::string exposure_key(const ArmRow& arm) { return "leakage/" + arm.name; }

}  // namespace

void Store::Impl::create_or_check_schema() const {
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
    execute(kProvenanceTable);
    execute(kFamilyColumns);
    execute(kMisplacedColumn);
    Statement insert(db, file, "INSERT INTO meta VALUES (?, ?)");
    const std::string now = utc_now();
    insert.bind(kSchemaVersion).bind(now).step();
  } else {
    const auto version = [&] { return query_integer("SELECT schema_version FROM meta", -1); };
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
    if (version() == kBeforeProvenance) {
      execute(kProvenanceTable);
      execute("UPDATE meta SET schema_version = 6;");
    }
    if (version() == kBeforeFamilies) {
      execute(kFamilyColumns);
      execute(kMisplacedColumn);
      execute("UPDATE meta SET schema_version = 7;");
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

Store::Store(const std::filesystem::path& file) : impl_(std::make_unique<Impl>()) {
  impl_->file = file;
  if (file.has_parent_path()) {
    std::error_code ignored;  // Opening the file reports it.
    std::filesystem::create_directories(file.parent_path(), ignored);
  }
  const int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX;
  if (sqlite3_open_v2(file.c_str(), &impl_->db, flags, nullptr) != SQLITE_OK) {
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
                  "INSERT INTO scene VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
    row.bind(run_id).bind(position++).bind(scene.name).bind(scene.title);
    row.bind(scene.scene_sha256).bind(scene.episodes_sha256).bind(scene.episodes);
    row.bind(scene.oracle_successes).bind(scene.oracle_episodes);
    row.bind(family_of(scene)).bind(scene.reconstruction).step();
  }
  position = 0;
  for (const ArmRow& arm : arm_rows) {
    Statement row(impl_->db, impl_->file,
                  "INSERT INTO arm VALUES ("
                  "?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
    row.bind(run_id).bind(position++).bind(arm.name).bind(arm.detector);
    row.bind(arm.weights_sha256).bind(arm.tuned_on).bind(arm.score_threshold);
    const HeldOutPrecision held_out = arm.held_out.value_or(HeldOutPrecision{});
    row.bind(held_out.views).bind(held_out.ap50).bind(held_out.ap);
    row.bind(held_out.score_threshold).bind(held_out.precision).bind(held_out.recall);
    row.bind(held_out.source_ap50.value_or(kNotMeasured));
    row.bind(held_out.unseen_ap50.value_or(kNotMeasured));
    const StartLeak leak = arm.start_leak.value_or(StartLeak{});
    row.bind(leak.views).bind(leak.near_starts).bind(leak.radius_m);
    row.bind(family_of(arm)).bind(arm.reconstruction);
    row.bind(arm.finetune_seed ? static_cast<std::int64_t>(*arm.finetune_seed) : kNoSeed);
    row.step();
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
  Statement select(impl_->db, impl_->file,
                   "SELECT name, title, scene_sha256, episodes_sha256, episodes, "
                   "oracle_successes, oracle_episodes, family, reconstruction FROM scene "
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
    scene.family = select.text();
    scene.reconstruction = select.small_integer();
    rows.push_back(std::move(scene));
  }
  return rows;
}

std::vector<ArmRow> Store::arms(std::int64_t run_id) const {
  Statement select(
      impl_->db, impl_->file,
      "SELECT name, detector, weights_sha256, tuned_on, score_threshold, "
      "held_out_views, ap50, ap, held_out_threshold, precision, recall, source_ap50, "
      "unseen_ap50, tuning_views, tuning_views_near_starts, start_radius_m, family, "
      "reconstruction, finetune_seed FROM arm "
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
    arm.family = select.text();
    arm.reconstruction = select.small_integer();
    const std::int64_t seed = select.integer();
    if (seed != kNoSeed) arm.finetune_seed = static_cast<std::uint64_t>(seed);
    rows.push_back(std::move(arm));
  }
  Statement exposure(impl_->db, impl_->file,
                     "SELECT value FROM provenance WHERE run_id = ? AND name = ?");
  for (ArmRow& arm : rows) {
    const std::string key = exposure_key(arm);
    exposure.reset().bind(run_id).bind(key);
    if (exposure.step()) arm.exposure = parse_exposure(exposure.text());
  }
  return rows;
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
