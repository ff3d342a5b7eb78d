// Databases of older and newer versions of the store.
#include <filesystem>
#include <set>
#include <string>

#include <gmock/gmock.h>

#include "experiments/records/internal/sqlite_statement.h"
#include "experiments/records/internal/store_schema.h"
#include "tests/experiments/records/column_values.h"
#include "tests/experiments/records/old_databases.h"
#include "tests/experiments/records/store_fixture.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;

/// Takes away what version 8 added.
void drop_version_8(const std::filesystem::path& file) {
  execute_sql(file,
              "ALTER TABLE attribution DROP COLUMN stop_views;"
              "UPDATE meta SET schema_version = 7");
}

/// Takes away what versions 7 and 8 added.
void drop_version_7(const std::filesystem::path& file) {
  drop_version_8(file);
  execute_sql(file,
              "ALTER TABLE scene DROP COLUMN family;"
              "ALTER TABLE scene DROP COLUMN reconstruction;"
              "ALTER TABLE arm DROP COLUMN family;"
              "ALTER TABLE arm DROP COLUMN reconstruction;"
              "ALTER TABLE arm DROP COLUMN finetune_seed;"
              "ALTER TABLE attribution DROP COLUMN misplaced_clouds;"
              "UPDATE meta SET schema_version = 6");
}

TEST_F(StoreTest, AnotherSchemaVersionIsRefused) {
  { const records::Store store(file_); }
  execute_sql(file_, "UPDATE meta SET schema_version = 99");
  EXPECT_THAT(refusal(file_), HasSubstr("version 99"));
  EXPECT_THAT(refusal(file_), HasSubstr("results.sqlite"));
}

TEST_F(StoreTest, AFileOfVersion2IsBroughtUpToDate) {
  std::int64_t id = 0;
  {
    records::Store store(file_);
    id = begin(store);
    store.add_trial(id, a_trial("before", "b/chair/00", true));
  }
  drop_version_7(file_);
  // What versions 3 to 6 added is taken away again.
  execute_sql(file_,
              "DROP TABLE attribution; DROP TABLE provenance;"
              "ALTER TABLE arm DROP COLUMN source_ap50;"
              "ALTER TABLE arm DROP COLUMN unseen_ap50;"
              "ALTER TABLE arm DROP COLUMN tuning_views;"
              "ALTER TABLE arm DROP COLUMN tuning_views_near_starts;"
              "ALTER TABLE arm DROP COLUMN start_radius_m;"
              "ALTER TABLE scene DROP COLUMN oracle_successes;"
              "ALTER TABLE scene DROP COLUMN oracle_episodes;"
              "UPDATE meta SET schema_version = 2");

  for (int opening = 0; opening < 2; ++opening) {  // The second finds nothing to do.
    records::Store store(file_);
    ASSERT_EQ(store.trials(id).size(), 1U);
    EXPECT_TRUE(store.trials(id)[0].success);
    EXPECT_FALSE(store.trials(id)[0].why.known());
    EXPECT_EQ(store.scenes(id)[0].oracle_episodes, -1);
    EXPECT_FALSE(store.arms(id)[0].start_leak.has_value());
  }
  records::Store store(file_);
  records::TrialRow trial = a_trial("after", "b/chair/00", false);
  trial.why.cause = records::Cause::kStuck;
  store.add_trial(id, trial);
  EXPECT_EQ(store.trials(id)[1].why.cause, records::Cause::kStuck);
}

TEST_F(StoreTest, AFileOfVersion1IsBroughtUpToDate) {
  execute_sql(file_, kVersion1);
  for (int opening = 0; opening < 2; ++opening) {  // The second finds nothing to do.
    records::Store store(file_);
    ASSERT_EQ(store.runs().size(), 1U);
    EXPECT_EQ(store.runs()[0].spec_text, "name: old");
    EXPECT_EQ(store.arms(1)[0].score_threshold, 0.25);
    EXPECT_FALSE(store.arms(1)[0].held_out.has_value());
    EXPECT_FALSE(store.arms(1)[0].start_leak.has_value());
    EXPECT_EQ(store.scenes(1)[0].oracle_successes, -1);
    ASSERT_EQ(store.trials(1).size(), 1U);
    EXPECT_TRUE(store.trials(1)[0].success);
    EXPECT_EQ(store.trials(1)[0].state_hash, 0xfedcba9876543210ULL);
    EXPECT_FALSE(store.trials(1)[0].why.known());
  }
  records::Store store(file_);  // And it takes what only the present version has.
  const std::int64_t id = begin(store);
  records::TrialRow trial = a_trial("after", "b/chair/00", false);
  trial.why.cause = records::Cause::kStuck;
  store.add_trial(id, trial);
  EXPECT_EQ(store.trials(id)[0].why.cause, records::Cause::kStuck);
  EXPECT_EQ(store.arms(id)[1].held_out->source_ap50, std::optional<double>(0.625));
}

/// "trial.spl REAL NOT NULL" of every column, and "trial: unique run_id arm" of every index.
std::set<std::string> schema_of(const std::filesystem::path& file) {
  sqlite3* db = nullptr;
  EXPECT_EQ(sqlite3_open(file.c_str(), &db), SQLITE_OK);
  std::set<std::string> schema;
  for (const char* sql :
       {"SELECT t.name || '.' || c.name || ' ' || c.type || (CASE c.\"notnull\" WHEN 1 THEN "
        "' NOT NULL' ELSE '' END) || (CASE c.pk WHEN 0 THEN '' ELSE ' key ' || c.pk END) "
        "FROM sqlite_master AS t JOIN pragma_table_info(t.name) AS c WHERE t.type = 'table'",
        "SELECT t.name || ': unique ' || (SELECT group_concat(c.name, ' ') FROM "
        "pragma_index_info(i.name) AS c) FROM sqlite_master AS t "
        "JOIN pragma_index_list(t.name) AS i WHERE t.type = 'table'"}) {
    records::Statement select(db, file, sql);
    while (select.step()) schema.insert(select.text());
  }
  sqlite3_close(db);
  return schema;
}

/// A column that a migration forgets, or that only a migration knows, is found here.
TEST_F(StoreTest, AllOlderVersionsGetTheSchemaOfNewFiles) {
  const std::filesystem::path fresh = folder_ / "new.sqlite";
  { const records::Store store(fresh); }
  const std::set<std::string> present = schema_of(fresh);
  EXPECT_TRUE(present.contains("trial.distance_to_goal_m REAL"));
  EXPECT_TRUE(present.contains("trial: unique run_id arm episode repetition"));
  for (int version = 1; version < records::Store::kSchemaVersion; ++version) {
    const std::filesystem::path file = folder_ / (std::to_string(version) + ".sqlite");
    execute_sql(file, kVersion1);
    for (const records::Migration& migration : records::migrations()) {
      if (migration.to <= version) execute_sql(file, migration.sql);
    }
    execute_sql(file, ("UPDATE meta SET schema_version = " + std::to_string(version)).c_str());
    const records::Store store(file);
    EXPECT_EQ(schema_of(file), present) << "version " << version;
    ASSERT_EQ(store.trials(1).size(), 1U);
    EXPECT_EQ(store.trials(1)[0].path_m, 3.25);
  }
}

TEST_F(StoreTest, AFileOfVersion7IsReadByTheNamesOfItsColumns) {
  execute_sql(file_, kVersion7);
  records::Store store(file_);
  const std::filesystem::path fresh = folder_ / "new.sqlite";
  { const records::Store other(fresh); }
  EXPECT_EQ(schema_of(file_), schema_of(fresh));

  const records::RunRow run = store.runs().at(0);
  EXPECT_EQ(run.seed, 18446744073709551557ULL);
  EXPECT_EQ(run.success_profile, "p");
  EXPECT_EQ(run.planned_n, 2);
  EXPECT_EQ(run.ended, "2026-01-01T02:00:00Z");
  EXPECT_EQ(run.provenance.at("clock"), "lockstep");
  const records::SceneRow scene = store.scenes(1).at(0);
  EXPECT_EQ(scene.oracle_episodes, 10);
  EXPECT_EQ(scene.family, "b");
  const records::ArmRow arm = store.arms(1).at(0);
  EXPECT_EQ(arm.held_out.value().recall, 0.625);
  EXPECT_EQ(arm.held_out->source_ap50, std::optional<double>(0.375));
  EXPECT_FALSE(arm.held_out->unseen_ap50.has_value());
  EXPECT_EQ(arm.start_leak.value().near_starts, 3);
  EXPECT_EQ(arm.finetune_seed, std::optional<std::uint64_t>(11));

  records::TrialRow expected;
  expected.trial_id = 1;
  expected.arm = "after";
  expected.scene = "b.r2";
  expected.episode = "b/chair/00";
  expected.goal_class = "chair";
  expected.repetition = 1;
  expected.outcome = records::TrialOutcome::kSuccess;
  expected.success = true;
  expected.stop_reason = core::StopReason::kGoalReached;
  expected.spl = 0.5;
  expected.soft_spl = 0.625;
  expected.path_m = 3.25;
  expected.shortest_path_m = 2.0;
  expected.distance_to_goal_m = 0.125;
  expected.sim_s = 10.5;
  expected.wall_s = 1.5;
  expected.ticks = 40;
  expected.contacts = 2;
  expected.contact_s = 0.25;
  expected.first_visible_tick = 3;
  expected.first_detected_tick = 4;
  expected.invalid_pixel_fraction = 0.015625;
  expected.state_hash = 0xfedcba9876543210ULL;
  expected.render_ms = 1.25;
  expected.detect_ms = 2.25;
  expected.policy_ms = 3.5;
  expected.error = "none";
  expected.picture = "p.png";
  expected.video = "v.mp4";
  expected.track = "t";
  expected.finished = "2026-01-01T01:00:00Z";
  expected.log = "logs/x";
  expected.why = {records::Cause::kDidNotFail,
                  36,
                  35,
                  150,
                  21,
                  20,
                  22,
                  5,
                  23,
                  6,
                  7,
                  12,
                  true,
                  1234,
                  0.75,
                  {},
                  3.5,
                  8,
                  9,
                  10};
  EXPECT_EQ(values_of(store.trials(1).at(0)), values_of(expected));
  store.add_trial(1, a_trial("after", "b/chair/01", true));
  EXPECT_EQ(store.trials(1).size(), 2U);
}

TEST_F(StoreTest, AFileOfVersion3IsBroughtUpToDate) {
  std::int64_t id = 0;
  {
    records::Store store(file_);
    id = begin(store);
    records::TrialRow trial = a_trial("before", "b/chair/00", false);
    trial.why.cause = records::Cause::kStuck;
    store.add_trial(id, trial);
  }
  drop_version_7(file_);
  execute_sql(file_,
              "DROP TABLE provenance;"
              "ALTER TABLE attribution DROP COLUMN images;"
              "ALTER TABLE arm DROP COLUMN source_ap50;"
              "ALTER TABLE arm DROP COLUMN unseen_ap50;"
              "ALTER TABLE arm DROP COLUMN tuning_views;"
              "ALTER TABLE arm DROP COLUMN tuning_views_near_starts;"
              "ALTER TABLE arm DROP COLUMN start_radius_m;"
              "UPDATE meta SET schema_version = 3");
  const records::Store store(file_);
  EXPECT_EQ(store.trials(id)[0].why.cause, records::Cause::kStuck);
  EXPECT_EQ(store.arms(id)[1].held_out->ap50, 0.5);
  EXPECT_FALSE(store.arms(id)[1].held_out->source_ap50.has_value());
  EXPECT_FALSE(store.arms(id)[1].start_leak.has_value());
}

TEST_F(StoreTest, AFileOfVersion5IsBroughtUpToDate) {
  std::int64_t id = 0;
  {
    records::Store store(file_);
    id = begin(store);
    store.add_trial(id, a_trial("before", "b/chair/00", true));
  }
  drop_version_7(file_);
  execute_sql(file_, "DROP TABLE provenance; UPDATE meta SET schema_version = 5");
  records::Store store(file_);
  EXPECT_EQ(store.trials(id).size(), 1U);
  EXPECT_TRUE(store.runs()[0].provenance.empty());
  store.set_provenance(id, "clock", "lockstep");
  EXPECT_EQ(store.runs()[0].provenance.at("clock"), "lockstep");
}

/// Every scene and every arm of an older file is the only one of its family. Its false objects
/// may be misplaced ones; nobody knows.
TEST_F(StoreTest, AFileOfVersion6IsBroughtUpToDate) {
  std::int64_t id = 0;
  {
    records::Store store(file_);
    id = begin(store);
    records::TrialRow trial = a_trial("before", "b/chair/00", false);
    trial.why.cause = records::Cause::kStuck;
    trial.why.false_clouds = 3;
    trial.why.misplaced_clouds = 2;
    store.add_trial(id, trial);
  }
  drop_version_7(file_);
  EXPECT_THROW((void)records::Store::for_reading(file_), core::InputError);
  for (int opening = 0; opening < 2; ++opening) {  // The second finds nothing to do.
    records::Store store(file_);
    ASSERT_EQ(store.trials(id).size(), 1U);
    EXPECT_EQ(store.trials(id)[0].why.false_clouds, 3);
    EXPECT_EQ(store.trials(id)[0].why.misplaced_clouds, -1);
    EXPECT_EQ(records::family_of(store.scenes(id)[0]), "b");
    EXPECT_EQ(store.scenes(id)[0].reconstruction, 1);
    EXPECT_EQ(records::family_of(store.arms(id)[1]), "after");
    EXPECT_EQ(store.arms(id)[1].reconstruction, 1);
    EXPECT_FALSE(store.arms(id)[1].finetune_seed.has_value());
    EXPECT_EQ(store.arms(id)[1].start_leak->near_starts, 3);
  }
}

/// Of trials of an older file nobody knows which views lie where they ended.
TEST_F(StoreTest, AFileOfVersion7IsBroughtUpToDate) {
  std::int64_t id = 0;
  {
    records::Store store(file_);
    id = begin(store);
    records::TrialRow trial = a_trial("before", "b/chair/00", true);
    trial.why.cause = records::Cause::kDidNotFail;
    trial.why.stop_views = 4;
    store.add_trial(id, trial);
    EXPECT_EQ(store.trials(id)[0].why.stop_views, 4);
  }
  drop_version_8(file_);
  records::Store store(file_);
  EXPECT_EQ(store.trials(id)[0].why.stop_views, -1);
}

TEST_F(StoreTest, FamiliesAndSeedsAreKept) {
  records::Store store(file_);
  records::SceneRow scene{"flat.r2", "Flat", "s", "e", 2};
  scene.family = "flat";
  scene.reconstruction = 2;
  records::ArmRow arm{"after.r2.s0", "v.bin", "fe", "flat.r2", -1, {}};
  arm.family = "after";
  arm.reconstruction = 2;
  arm.finetune_seed = 0;
  const std::int64_t id = store.begin_run(a_run(), {scene}, {arm});
  EXPECT_EQ(store.scenes(id)[0].family, "flat");
  EXPECT_EQ(store.scenes(id)[0].reconstruction, 2);
  EXPECT_EQ(store.arms(id)[0].family, "after");
  EXPECT_EQ(store.arms(id)[0].reconstruction, 2);
  EXPECT_EQ(store.arms(id)[0].finetune_seed, std::optional<std::uint64_t>(0));
}

}  // namespace
}  // namespace segsim::experiments
