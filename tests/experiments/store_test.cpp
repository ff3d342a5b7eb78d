#include "experiments/store/store.h"

#include <filesystem>
#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "experiments/store/trial_export.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// A folder of its own, removed in the end.
class StoreTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("segsim_store_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    file_ = folder_ / "results.sqlite";
  }
  void TearDown() override { fs::remove_all(folder_); }

  fs::path folder_, file_;
};

RunRow a_run() {
  RunRow run;
  run.name = "demo";
  run.title = "Demo";
  run.spec_sha256 = "abc";
  run.spec_text = "name: demo\n";
  run.code_version = "0.1";
  run.host = "h";
  run.success_profile = "p";
  run.seed = 18446744073709551557ULL;  // Larger than SQLite's signed integers.
  run.planned_n = 4;
  run.planned_trials = 8;
  return run;
}

std::int64_t begin(Store& store) {
  return store.begin_run(a_run(),
                         {{"b", "Scene B", "s1", "e1", 2}, {"a", "Scene A", "s2", "e2", 2}},
                         {{"before", "w.bin", "ff", "", -1, {}},
                          {"after", "v.bin", "fe", "b", 0.5,
                           HeldOutPrecision{60, 0.5, 0.25, 0.2, 0.75, 0.625, 0.625, 0.0},
                           StartLeak{400, 3, 1.0}}});
}

TrialRow a_trial(const std::string& arm, const std::string& episode, bool success) {
  TrialRow trial;
  trial.arm = arm;
  trial.scene = episode.substr(0, 1);
  trial.episode = episode;
  trial.goal_class = "chair";
  trial.outcome = success ? "success" : "timeout";
  trial.success = success;
  trial.spl = success ? 0.5 : 0.0;
  trial.path_m = 3.25;
  trial.distance_to_goal_m = 0.125;
  trial.ticks = 17;
  trial.state_hash = 0xfedcba9876543210ULL;
  return trial;
}

TEST_F(StoreTest, WhatIsWrittenIsReadBack) {
  std::int64_t id = 0;
  {
    Store store(file_);
    id = begin(store);
    store.add_trial(id, a_trial("before", "b/chair/00", true));
  }
  const Store store(file_);
  ASSERT_EQ(store.runs().size(), 1U);
  const RunRow run = store.runs()[0];
  EXPECT_EQ(run.spec_text, "name: demo\n");
  EXPECT_EQ(run.seed, 18446744073709551557ULL);
  EXPECT_EQ(run.planned_trials, 8);
  EXPECT_FALSE(run.started.empty());
  EXPECT_TRUE(run.ended.empty());
  EXPECT_EQ(store.scenes(id)[0].name, "b");
  EXPECT_EQ(store.arms(id)[1].tuned_on, "b");
  EXPECT_FALSE(store.arms(id)[0].held_out.has_value());
  ASSERT_TRUE(store.arms(id)[1].held_out.has_value());
  const HeldOutPrecision held_out = *store.arms(id)[1].held_out;
  EXPECT_EQ(held_out.views, 60);
  EXPECT_EQ(held_out.ap50, 0.5);
  EXPECT_EQ(held_out.ap, 0.25);
  EXPECT_EQ(held_out.score_threshold, 0.2);
  EXPECT_EQ(held_out.precision, 0.75);
  EXPECT_EQ(held_out.recall, 0.625);
  EXPECT_EQ(held_out.source_ap50, std::optional<double>(0.625));
  EXPECT_EQ(held_out.unseen_ap50, std::optional<double>(0.0));
  EXPECT_FALSE(store.arms(id)[0].start_leak.has_value());
  const std::optional<StartLeak> leak = store.arms(id)[1].start_leak;
  ASSERT_TRUE(leak.has_value());
  EXPECT_EQ(leak->views, 400);
  EXPECT_EQ(leak->near_starts, 3);
  EXPECT_EQ(leak->radius_m, 1.0);
  ASSERT_EQ(store.trials(id).size(), 1U);
  const TrialRow trial = store.trials(id)[0];
  EXPECT_EQ(trial.episode, "b/chair/00");
  EXPECT_TRUE(trial.success);
  EXPECT_EQ(trial.path_m, 3.25);
  EXPECT_EQ(trial.distance_to_goal_m.value(), 0.125);
  EXPECT_EQ(trial.first_visible_tick, -1);
  EXPECT_EQ(trial.state_hash, 0xfedcba9876543210ULL);
}

TEST_F(StoreTest, OrderDoesNotDependOnInsertion) {
  Store store(file_);
  const std::int64_t id = begin(store);
  for (const auto& [arm, episode] :
       std::vector<std::pair<std::string, std::string>>{{"after", "a/chair/00"},
                                                        {"before", "b/chair/01"},
                                                        {"after", "b/chair/00"},
                                                        {"before", "b/chair/00"},
                                                        {"before", "a/chair/00"}}) {
    store.add_trial(id, a_trial(arm, episode, true));
  }
  std::string order;
  for (const TrialRow& t : store.trials(id)) order += t.episode + "=" + t.arm + " ";
  // Scenes and arms in the order of the spec, episodes by name.
  EXPECT_EQ(order,
            "b/chair/00=before b/chair/00=after b/chair/01=before a/chair/00=before "
            "a/chair/00=after ");
}

TEST_F(StoreTest, ATrialIsStoredOnce) {
  Store store(file_);
  const std::int64_t id = begin(store);
  store.add_trial(id, a_trial("before", "b/chair/00", true));
  EXPECT_THROW(store.add_trial(id, a_trial("before", "b/chair/00", false)), core::InputError);
  ASSERT_EQ(store.trials(id).size(), 1U);
  EXPECT_TRUE(store.trials(id)[0].success);  // The first one stays.
  // Another repetition, arm or run is another trial.
  TrialRow again = a_trial("before", "b/chair/00", false);
  again.repetition = 1;
  store.add_trial(id, again);
  store.add_trial(begin(store), a_trial("before", "b/chair/00", false));
  EXPECT_EQ(store.trials(id).size(), 2U);
}

TEST_F(StoreTest, AFailedTrialIsReplaced) {
  Store store(file_);
  const std::int64_t id = begin(store);
  TrialRow failed = a_trial("before", "b/chair/00", false);
  failed.outcome = "error";
  failed.error = "no memory";
  store.add_trial(id, failed);
  EXPECT_TRUE(store.trials(id)[0].failed());
  store.add_trial(id, a_trial("before", "b/chair/00", true));
  ASSERT_EQ(store.trials(id).size(), 1U);
  EXPECT_FALSE(store.trials(id)[0].failed());
}

TEST_F(StoreTest, AKilledProcessLeavesOnlyWholeTrials) {
  std::int64_t id = 0;
  {
    Store store(file_);
    id = begin(store);
  }
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    // One finished trial, then death in the middle of the next transaction.
    Store store(file_);
    store.add_trial(id, a_trial("before", "b/chair/00", true));
    sqlite3* db = nullptr;
    sqlite3_open(file_.c_str(), &db);
    const std::string copy =
        "BEGIN IMMEDIATE; CREATE TEMP TABLE t AS SELECT * FROM trial; UPDATE t SET trial_id = "
        "NULL, episode = 'b/chair/99'; INSERT INTO trial SELECT * FROM t;";
    const bool inserted =
        sqlite3_exec(db, copy.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK &&
        sqlite3_changes(db) == 1;
    if (!inserted) _exit(1);
    kill(getpid(), SIGKILL);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFSIGNALED(status));

  Store store(file_);
  ASSERT_EQ(store.trials(id).size(), 1U);
  EXPECT_EQ(store.trials(id)[0].episode, "b/chair/00");
  store.add_trial(id, a_trial("before", "b/chair/99", true));  // It can go on.
  EXPECT_EQ(store.trials(id).size(), 2U);
}

/// The message with which a database is refused.
std::string refusal(const fs::path& file) {
  try {
    const Store store(file);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return {};
}

TEST_F(StoreTest, AnotherSchemaVersionIsRefused) {
  { const Store store(file_); }
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &db), SQLITE_OK);
  sqlite3_exec(db, "UPDATE meta SET schema_version = 99", nullptr, nullptr, nullptr);
  sqlite3_close(db);
  EXPECT_THAT(refusal(file_), HasSubstr("version 99"));
  EXPECT_THAT(refusal(file_), HasSubstr("results.sqlite"));
}

TEST_F(StoreTest, AttributionIsReadBackAndGoesWithItsTrial) {
  Store store(file_);
  const std::int64_t id = begin(store);
  TrialRow failed = a_trial("before", "b/chair/00", false);
  failed.outcome = "error";
  failed.why.cause = "harness_error";
  store.add_trial(id, failed);
  EXPECT_EQ(store.trials(id)[0].why.cause, "harness_error");
  TrialRow trial = a_trial("before", "b/chair/00", false);
  trial.log = "logs/x.json.gz";
  trial.why.cause = "false_positive";
  trial.why.inevitable_tick = 16;
  trial.why.decisive_tick = 9;
  trial.why.images = 40;
  trial.why.visible_frames = 5;
  trial.why.detected_frames = 4;
  trial.why.true_detections = 6;
  trial.why.false_detections = 7;
  trial.why.first_true_tick = 3;
  trial.why.true_clouds = 1;
  trial.why.false_clouds = 2;
  trial.why.stopped = true;
  trial.why.final_visible_px = 77;
  trial.why.object_m = 0.0;
  trial.why.shortest_object_m = 4.5;
  trial.why.collision_ticks = 8;
  trial.why.off_navmesh_ticks = 11;
  trial.why.reached_instance = 12;
  store.add_trial(id, trial);  // In place of the failed one.
  store.add_trial(id, a_trial("after", "b/chair/00", true));
  const std::vector<TrialRow> rows = store.trials(id);
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_GT(rows[0].trial_id, 0);
  EXPECT_NE(rows[0].trial_id, rows[1].trial_id);
  EXPECT_EQ(rows[0].log, "logs/x.json.gz");
  const Attribution& why = rows[0].why;
  EXPECT_EQ(why.cause, "false_positive");
  const std::vector<int> numbers{
      why.inevitable_tick,  why.decisive_tick,   why.visible_frames,
      why.detected_frames,  why.true_detections, why.false_detections,
      why.first_true_tick,  why.true_clouds,     why.false_clouds,
      why.final_visible_px, why.collision_ticks, why.off_navmesh_ticks,
      why.reached_instance, why.images};
  EXPECT_EQ(numbers, (std::vector<int>{16, 9, 5, 4, 6, 7, 3, 1, 2, 77, 8, 11, 12, 40}));
  EXPECT_TRUE(why.stopped);
  EXPECT_EQ(why.object_m, 0.0);
  EXPECT_FALSE(why.planar_m.has_value());
  EXPECT_EQ(why.shortest_object_m, 4.5);
  EXPECT_FALSE(rows[1].why.known());
}

TEST_F(StoreTest, AFileOfVersion2IsBroughtUpToDate) {
  std::int64_t id = 0;
  {
    Store store(file_);
    id = begin(store);
    store.add_trial(id, a_trial("before", "b/chair/00", true));
  }
  // What versions 3 to 6 added is taken away again.
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db,
                         "DROP TABLE attribution; DROP TABLE provenance;"
                         "ALTER TABLE arm DROP COLUMN source_ap50;"
                         "ALTER TABLE arm DROP COLUMN unseen_ap50;"
                         "ALTER TABLE arm DROP COLUMN tuning_views;"
                         "ALTER TABLE arm DROP COLUMN tuning_views_near_starts;"
                         "ALTER TABLE arm DROP COLUMN start_radius_m;"
                         "ALTER TABLE scene DROP COLUMN oracle_successes;"
                         "ALTER TABLE scene DROP COLUMN oracle_episodes;"
                         "UPDATE meta SET schema_version = 2",
                         nullptr, nullptr, nullptr),
            SQLITE_OK);
  sqlite3_close(db);

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
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, kVersion1, nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
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
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db,
                         "DROP TABLE provenance;"
                         "ALTER TABLE attribution DROP COLUMN images;"
                         "ALTER TABLE arm DROP COLUMN source_ap50;"
                         "ALTER TABLE arm DROP COLUMN unseen_ap50;"
                         "ALTER TABLE arm DROP COLUMN tuning_views;"
                         "ALTER TABLE arm DROP COLUMN tuning_views_near_starts;"
                         "ALTER TABLE arm DROP COLUMN start_radius_m;"
                         "UPDATE meta SET schema_version = 3",
                         nullptr, nullptr, nullptr),
            SQLITE_OK);
  sqlite3_close(db);
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
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "DROP TABLE provenance; UPDATE meta SET schema_version = 5",
                         nullptr, nullptr, nullptr),
            SQLITE_OK);
  sqlite3_close(db);
  Store store(file_);
  EXPECT_EQ(store.trials(id).size(), 1U);
  EXPECT_TRUE(store.runs()[0].provenance.empty());
  store.set_provenance(id, "clock", "lockstep");
  EXPECT_EQ(store.runs()[0].provenance.at("clock"), "lockstep");
}

TEST_F(StoreTest, ProvenanceIsKeptByRunAndReplaced) {
  Store store(file_);
  RunRow run = a_run();
  run.provenance = {{"clock", "lockstep"}, {"library/libtorch", "1.13"}};
  const std::int64_t first = store.begin_run(run, {}, {{"before", "w.bin", "ff", "", -1, {}}});
  const std::int64_t second = begin(store);
  store.set_provenance(first, "clock", "virtual time");
  store.set_provenance(first, "shard", "0/2");
  using Provenance = std::map<std::string, std::string>;
  EXPECT_EQ(
      store.runs()[0].provenance,
      (Provenance{{"clock", "virtual time"}, {"library/libtorch", "1.13"}, {"shard", "0/2"}}));
  EXPECT_EQ(store.runs()[1].run_id, second);
  EXPECT_TRUE(store.runs()[1].provenance.empty());
}

TEST_F(StoreTest, AllTrialsOfACallAreAddedOrNone) {
  Store store(file_);
  const std::int64_t id = begin(store);
  store.add_trial(id, a_trial("before", "b/chair/01", true));
  std::vector<TrialRow> trials{a_trial("before", "b/chair/00", true),
                               a_trial("before", "b/chair/01", true)};
  trials[0].finished = "2026-01-01T00:00:00Z";
  EXPECT_THROW(store.add_trials(id, trials), core::InputError);
  EXPECT_EQ(store.trials(id).size(), 1U);
  trials.pop_back();
  store.add_trials(id, trials);
  ASSERT_EQ(store.trials(id).size(), 2U);
  EXPECT_EQ(store.trials(id)[0].finished, "2026-01-01T00:00:00Z");
}

TEST_F(StoreTest, JsonLinesHoldTheRunAndEveryColumn) {
  {
    Store store(file_);
    const std::int64_t id = begin(store);
    store.set_provenance(id, "clock", "lockstep");
    TrialRow trial = a_trial("before", "b/chair/00", false);
    trial.distance_to_goal_m.reset();
    trial.error = "line\n\"two\" \xff";
    trial.log = "logs/x.gz";
    trial.why.cause = "stuck";
    trial.why.planar_m = 1.5;
    store.add_trial(id, trial);
    store.add_trial(id, a_trial("after", "b/chair/00", true));
  }
  std::ostringstream out;
  write_trials_jsonl(out, load_run(folder_));
  std::istringstream lines(out.str());
  std::vector<nlohmann::json> read;
  for (std::string line; std::getline(lines, line);)
    read.push_back(nlohmann::json::parse(line));
  ASSERT_EQ(read.size(), 3U);
  EXPECT_EQ(read[0]["run"]["spec_text"], "name: demo\n");
  EXPECT_EQ(read[0]["run"]["provenance"]["clock"], "lockstep");
  EXPECT_EQ(read[0]["run"]["seed"], 18446744073709551557ULL);
  EXPECT_EQ(read[0]["arms"][1]["tuned_on"], "b");
  EXPECT_EQ(read[0]["arms"][1]["tuning_views"]["near_starts"], 3);
  EXPECT_TRUE(read[0]["arms"][0]["held_out"].is_null());
  EXPECT_EQ(read[1]["arm"], "before");
  EXPECT_TRUE(read[1]["distance_to_goal_m"].is_null());
  EXPECT_EQ(read[1]["error"], "line\n\"two\" \xef\xbf\xbd");
  EXPECT_EQ(read[1]["state_hash"], "fedcba9876543210");
  EXPECT_EQ(read[1]["why"]["planar_m"], 1.5);
  EXPECT_TRUE(read[1]["why"]["object_m"].is_null());
  EXPECT_TRUE(read[2]["why"].is_null());
  EXPECT_EQ(read[1].size(), read[2].size());
}

TEST_F(StoreTest, OtherFilesAreRefused) {
  const fs::path foreign = folder_ / "foreign.sqlite";
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(foreign.c_str(), &db), SQLITE_OK);
  sqlite3_exec(db, "CREATE TABLE recipes (name TEXT)", nullptr, nullptr, nullptr);
  sqlite3_close(db);
  EXPECT_THAT(refusal(foreign), HasSubstr("another SQLite database"));
  const fs::path text = folder_ / "notes.txt";
  std::ofstream(text) << "This is no database, but it is long enough to be taken for one. "
                      << std::string(2000, '.');
  EXPECT_THAT(refusal(text), HasSubstr("notes.txt"));
}

TEST_F(StoreTest, CsvHasNoNaNAndQuotesWhatNeedsIt) {
  TrialRow trial = a_trial("before", "b/chair/00", false);
  trial.distance_to_goal_m.reset();
  trial.stop_reason = "stuck, \"badly\"";
  std::ostringstream out;
  write_trials_csv(out, {trial});
  const std::string text = out.str();
  EXPECT_THAT(text, HasSubstr("\"stuck, \"\"badly\"\"\""));
  EXPECT_EQ(text.find("nan"), std::string::npos);
  EXPECT_EQ(text.find("inf"), std::string::npos);
  // As many fields in the row as in the header.
  const std::string header = text.substr(0, text.find('\n'));
  const auto commas = [](const std::string& s) { return std::count(s.begin(), s.end(), ','); };
  EXPECT_EQ(commas(header), commas(text.substr(header.size())) - 1);  // One comma is quoted.
}

}  // namespace
}  // namespace segsim::experiments
