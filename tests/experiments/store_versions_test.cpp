// Databases of older and newer versions of the store.
#include <gmock/gmock.h>

#include "store_fixture.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;

/// Takes away what version 7 added.
void drop_version_7(const std::filesystem::path& file) {
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
  { const Store store(file_); }
  execute_sql(file_, "UPDATE meta SET schema_version = 99");
  EXPECT_THAT(refusal(file_), HasSubstr("version 99"));
  EXPECT_THAT(refusal(file_), HasSubstr("results.sqlite"));
}

TEST_F(StoreTest, AFileOfVersion2IsBroughtUpToDate) {
  std::int64_t id = 0;
  {
    Store store(file_);
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
    Store store(file_);
    ASSERT_EQ(store.trials(id).size(), 1U);
    EXPECT_TRUE(store.trials(id)[0].success);
    EXPECT_FALSE(store.trials(id)[0].why.known());
    EXPECT_EQ(store.scenes(id)[0].oracle_episodes, -1);
    EXPECT_FALSE(store.arms(id)[0].start_leak.has_value());
  }
  Store store(file_);
  TrialRow trial = a_trial("after", "b/chair/00", false);
  trial.why.cause = "stuck";
  store.add_trial(id, trial);
  EXPECT_EQ(store.trials(id)[1].why.cause, "stuck");
}

/// A file as version 1 of the store made it: one run, one arm, one trial.
constexpr const char* kVersion1 = R"sql(
CREATE TABLE meta (schema_version INTEGER NOT NULL, created TEXT NOT NULL);
CREATE TABLE run (
  run_id INTEGER PRIMARY KEY, name TEXT NOT NULL, title TEXT NOT NULL,
  spec_sha256 TEXT NOT NULL, spec_text TEXT NOT NULL, code_version TEXT NOT NULL,
  host TEXT NOT NULL, libraries TEXT NOT NULL, success_profile TEXT NOT NULL,
  seed INTEGER NOT NULL, planned_n INTEGER NOT NULL, planned_trials INTEGER NOT NULL,
  started TEXT NOT NULL, ended TEXT NOT NULL);
CREATE TABLE scene (
  run_id INTEGER NOT NULL REFERENCES run, position INTEGER NOT NULL, name TEXT NOT NULL,
  title TEXT NOT NULL, scene_sha256 TEXT NOT NULL, episodes_sha256 TEXT NOT NULL,
  episodes INTEGER NOT NULL, UNIQUE (run_id, name));
CREATE TABLE arm (
  run_id INTEGER NOT NULL REFERENCES run, position INTEGER NOT NULL, name TEXT NOT NULL,
  detector TEXT NOT NULL, weights_sha256 TEXT NOT NULL, tuned_on TEXT NOT NULL,
  score_threshold REAL NOT NULL, UNIQUE (run_id, name));
CREATE TABLE trial (
  trial_id INTEGER PRIMARY KEY, run_id INTEGER NOT NULL REFERENCES run,
  arm TEXT NOT NULL, scene TEXT NOT NULL, episode TEXT NOT NULL, goal_class TEXT NOT NULL,
  repetition INTEGER NOT NULL, outcome TEXT NOT NULL, success INTEGER NOT NULL,
  stop_reason TEXT NOT NULL, spl REAL NOT NULL, soft_spl REAL NOT NULL, path_m REAL NOT NULL,
  shortest_path_m REAL NOT NULL, distance_to_goal_m REAL, sim_s REAL NOT NULL,
  wall_s REAL NOT NULL, ticks INTEGER NOT NULL, contacts INTEGER NOT NULL,
  contact_s REAL NOT NULL, first_visible_tick INTEGER NOT NULL,
  first_detected_tick INTEGER NOT NULL, invalid_pixel_fraction REAL NOT NULL,
  state_hash TEXT NOT NULL, render_ms REAL NOT NULL, detect_ms REAL NOT NULL,
  policy_ms REAL NOT NULL, error TEXT NOT NULL, picture TEXT NOT NULL, video TEXT NOT NULL,
  track TEXT NOT NULL, finished TEXT NOT NULL,
  UNIQUE (run_id, arm, episode, repetition));
INSERT INTO meta VALUES (1, '2025-01-01T00:00:00Z');
INSERT INTO run VALUES (1, 'old', 'Old', 'aa', 'name: old', '0.0.1', 'h', 'l', 'p', 5, 0, 1,
  '2025-01-01T00:00:00Z', '');
INSERT INTO scene VALUES (1, 0, 'b', 'Scene B', 's', 'e', 1);
INSERT INTO arm VALUES (1, 0, 'before', 'w.bin', 'ff', 'b', 0.25);
INSERT INTO trial VALUES (1, 1, 'before', 'b', 'b/chair/00', 'chair', 0, 'success', 1, 'stop',
  0.5, 0.5, 3.25, 2.0, NULL, 10, 1, 40, 0, 0, 3, 4, 0.01, 'fedcba9876543210', 1, 2, 3, '', '',
  '', '', '2025-01-01T00:01:00Z');
)sql";

TEST_F(StoreTest, AFileOfVersion1IsBroughtUpToDate) {
  execute_sql(file_, kVersion1);
  for (int opening = 0; opening < 2; ++opening) {  // The second finds nothing to do.
    Store store(file_);
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
  Store store(file_);  // And it takes what only the present version has.
  const std::int64_t id = begin(store);
  TrialRow trial = a_trial("after", "b/chair/00", false);
  trial.why.cause = "stuck";
  store.add_trial(id, trial);
  EXPECT_EQ(store.trials(id)[0].why.cause, "stuck");
  EXPECT_EQ(store.arms(id)[1].held_out->source_ap50, std::optional<double>(0.625));
}

TEST_F(StoreTest, AFileOfVersion3IsBroughtUpToDate) {
  std::int64_t id = 0;
  {
    Store store(file_);
    id = begin(store);
    TrialRow trial = a_trial("before", "b/chair/00", false);
    trial.why.cause = "stuck";
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
  const Store store(file_);
  EXPECT_EQ(store.trials(id)[0].why.cause, "stuck");
  EXPECT_EQ(store.arms(id)[1].held_out->ap50, 0.5);
  EXPECT_FALSE(store.arms(id)[1].held_out->source_ap50.has_value());
  EXPECT_FALSE(store.arms(id)[1].start_leak.has_value());
}

TEST_F(StoreTest, AFileOfVersion5IsBroughtUpToDate) {
  std::int64_t id = 0;
  {
    Store store(file_);
    id = begin(store);
    store.add_trial(id, a_trial("before", "b/chair/00", true));
  }
  drop_version_7(file_);
  execute_sql(file_, "DROP TABLE provenance; UPDATE meta SET schema_version = 5");
  Store store(file_);
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
    Store store(file_);
    id = begin(store);
    TrialRow trial = a_trial("before", "b/chair/00", false);
    trial.why.cause = "stuck";
    trial.why.false_clouds = 3;
    trial.why.misplaced_clouds = 2;
    store.add_trial(id, trial);
  }
  drop_version_7(file_);
  EXPECT_THROW((void)Store::for_reading(file_), core::InputError);
  for (int opening = 0; opening < 2; ++opening) {  // The second finds nothing to do.
    Store store(file_);
    ASSERT_EQ(store.trials(id).size(), 1U);
    EXPECT_EQ(store.trials(id)[0].why.false_clouds, 3);
    EXPECT_EQ(store.trials(id)[0].why.misplaced_clouds, -1);
    EXPECT_EQ(family_of(store.scenes(id)[0]), "b");
    EXPECT_EQ(store.scenes(id)[0].reconstruction, 1);
    EXPECT_EQ(family_of(store.arms(id)[1]), "after");
    EXPECT_EQ(store.arms(id)[1].reconstruction, 1);
    EXPECT_FALSE(store.arms(id)[1].finetune_seed.has_value());
    EXPECT_EQ(store.arms(id)[1].start_leak->near_starts, 3);
  }
}

TEST_F(StoreTest, FamiliesAndSeedsAreKept) {
  Store store(file_);
  SceneRow scene{"flat.r2", "Flat", "s", "e", 2};
  scene.family = "flat";
  scene.reconstruction = 2;
  ArmRow arm{"after.r2.s0", "v.bin", "fe", "flat.r2", -1, {}};
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
