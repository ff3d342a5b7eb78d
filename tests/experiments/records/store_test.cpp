#include "experiments/records/store.h"

#include <filesystem>
#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "experiments/records/internal/arm_columns.h"
#include "experiments/results/trial_export.h"
#include "tests/experiments/records/column_values.h"
#include "tests/experiments/records/store_fixture.h"

namespace {

int clock_set_by_s = 0;  ///< As if somebody had set the clock.

}  // namespace

/// In the place of the C library's.
extern "C" int clock_gettime(clockid_t clock, timespec* time) {
  const long result = ::syscall(SYS_clock_gettime, clock, time);
  if (clock == CLOCK_REALTIME) time->tv_sec += clock_set_by_s;
  return static_cast<int>(result);
}

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

TEST_F(StoreTest, WhatIsWrittenIsReadBack) {
  const auto run = with_distinct_values<records::RunRow>();
  const auto scene = with_distinct_values<records::SceneRow>();
  const auto arm = with_distinct_values<records::ArmColumns>();
  const auto trial = with_distinct_values<records::TrialRow>();
  std::int64_t id = 0;
  {
    records::Store store(file_);
    id = store.begin_run(run, {scene}, {records::arm_of(arm)});
    store.add_trial(id, trial);
  }
  const records::Store store(file_);
  ASSERT_EQ(store.trials(id).size(), 1U);
  records::TrialRow read = store.trials(id)[0];
  EXPECT_GT(read.trial_id, 0);
  read.trial_id = trial.trial_id;
  EXPECT_EQ(values_of(read), values_of(trial));
  ASSERT_EQ(store.runs().size(), 1U);
  records::RunRow read_run = store.runs()[0];
  EXPECT_EQ(read_run.run_id, id);
  EXPECT_NE(read_run.started, run.started) << "the store says when a run began";
  EXPECT_EQ(read_run.ended, "");
  read_run.run_id = run.run_id;
  read_run.started = run.started;
  read_run.ended = run.ended;
  EXPECT_EQ(values_of(read_run), values_of(run));
  ASSERT_EQ(store.scenes(id).size(), 1U);
  EXPECT_EQ(values_of(store.scenes(id)[0]), values_of(scene));
  ASSERT_EQ(store.arms(id).size(), 1U);
  EXPECT_EQ(values_of(records::columns_of(store.arms(id)[0])), values_of(arm));
}

/// Times of a run keep their order, whatever the clock is set to.
TEST_F(StoreTest, SettingTheClockDoesNotReachTheTimes) {
  const std::string first = records::utc_now();
  clock_set_by_s = 100'000;
  const std::string second = records::utc_now();
  clock_set_by_s = -100'000;
  const std::string third = records::utc_now();
  EXPECT_LE(first, second);
  EXPECT_LE(second, third);
  clock_set_by_s = 0;
}

/// As another user than root, which may write everywhere.
TEST_F(StoreTest, AFolderThatMayNotBeWrittenToIsSaidSo) {
  { const records::Store store(file_); }
  fs::permissions(file_, fs::perms::owner_read | fs::perms::others_read);
  fs::permissions(folder_.path(), fs::perms::owner_read | fs::perms::owner_exec |
                                      fs::perms::others_read | fs::perms::others_exec);
  const bool root = ::geteuid() == 0;
  ASSERT_EQ(::seteuid(root ? 65534 : ::geteuid()), 0);
  const std::string said = refusal(file_), of_new = refusal(folder_ / "new.sqlite");
  ASSERT_EQ(::seteuid(root ? 0 : ::geteuid()), 0);
  fs::permissions(folder_.path(), fs::perms::owner_all);
  EXPECT_THAT(said, HasSubstr("results.sqlite: expected a database in a folder that can be"));
  EXPECT_THAT(of_new, HasSubstr("new.sqlite: expected a database in a folder that can be"));
}

/// What lies flat in the database, or elsewhere.
TEST_F(StoreTest, OptionalPartsOfAnArmAreReadBack) {
  records::Store store(file_);
  const std::int64_t id = begin(store);
  EXPECT_EQ(store.runs()[0].seed, 18446744073709551557ULL);
  const records::ArmRow before = store.arms(id)[0], after = store.arms(id)[1];
  EXPECT_FALSE(before.held_out.has_value());
  EXPECT_FALSE(before.start_leak.has_value());
  EXPECT_FALSE(before.exposure.has_value());
  EXPECT_FALSE(before.finetune_seed.has_value());
  ASSERT_TRUE(after.held_out.has_value());
  EXPECT_EQ(after.held_out->views, 60);
  EXPECT_EQ(after.held_out->source_ap50, std::optional<double>(0.625));
  EXPECT_EQ(after.held_out->unseen_ap50, std::optional<double>(0.0));
  ASSERT_TRUE(after.start_leak.has_value());
  EXPECT_EQ(after.start_leak->near_starts, 3);
  EXPECT_EQ(after.exposure, (records::SceneExposure{
                                {"b"}, {"b", "a"}, {}, records::TrainingDataKnown::kPart}));
  EXPECT_EQ(store.runs()[0].provenance.at("leakage/after"),
            "partly unknown; trained on b; threshold chosen on b, a");
}

TEST_F(StoreTest, OrderDoesNotDependOnInsertion) {
  records::Store store(file_);
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
  for (const records::TrialRow& t : store.trials(id)) order += t.episode + "=" + t.arm + " ";
  // Scenes and arms in the order of the spec, episodes by name.
  EXPECT_EQ(order,
            "b/chair/00=before b/chair/00=after b/chair/01=before a/chair/00=before "
            "a/chair/00=after ");
}

TEST_F(StoreTest, ATrialIsStoredOnce) {
  records::Store store(file_);
  const std::int64_t id = begin(store);
  store.add_trial(id, a_trial("before", "b/chair/00", true));
  EXPECT_THROW(store.add_trial(id, a_trial("before", "b/chair/00", false)), core::InputError);
  ASSERT_EQ(store.trials(id).size(), 1U);
  EXPECT_TRUE(store.trials(id)[0].success);  // The first one stays.
  // Another repetition, arm or run is another trial.
  records::TrialRow again = a_trial("before", "b/chair/00", false);
  again.repetition = 1;
  store.add_trial(id, again);
  store.add_trial(begin(store), a_trial("before", "b/chair/00", false));
  EXPECT_EQ(store.trials(id).size(), 2U);
}

TEST_F(StoreTest, AFailedTrialIsReplaced) {
  records::Store store(file_);
  const std::int64_t id = begin(store);
  records::TrialRow failed = a_trial("before", "b/chair/00", false);
  failed.outcome = records::TrialOutcome::kError;
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
    records::Store store(file_);
    id = begin(store);
  }
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    // One finished trial, then death in the middle of the next transaction.
    records::Store store(file_);
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

  records::Store store(file_);
  ASSERT_EQ(store.trials(id).size(), 1U);
  EXPECT_EQ(store.trials(id)[0].episode, "b/chair/00");
  store.add_trial(id, a_trial("before", "b/chair/99", true));  // It can go on.
  EXPECT_EQ(store.trials(id).size(), 2U);
}

TEST_F(StoreTest, AttributionGoesWithItsTrial) {
  records::Store store(file_);
  const std::int64_t id = begin(store);
  records::TrialRow failed = a_trial("before", "b/chair/00", false);
  failed.outcome = records::TrialOutcome::kError;
  failed.why.cause = records::Cause::kHarnessError;
  store.add_trial(id, failed);
  EXPECT_EQ(store.trials(id)[0].why.cause, records::Cause::kHarnessError);
  records::TrialRow trial = a_trial("before", "b/chair/00", false);
  trial.why.cause = records::Cause::kFalsePositive;
  trial.why.object_m = 0.0;
  store.add_trial(id, trial);  // In place of the failed one.
  store.add_trial(id, a_trial("after", "b/chair/00", true));
  const std::vector<records::TrialRow> rows = store.trials(id);
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_GT(rows[0].trial_id, 0);
  EXPECT_NE(rows[0].trial_id, rows[1].trial_id);
  EXPECT_EQ(rows[0].why.cause, records::Cause::kFalsePositive);
  EXPECT_EQ(rows[0].why.object_m, 0.0);
  EXPECT_FALSE(rows[0].why.planar_m.has_value());
  EXPECT_EQ(values_of(rows[1].why), values_of(records::Attribution{}));
}

TEST_F(StoreTest, ProvenanceIsKeptByRunAndReplaced) {
  records::Store store(file_);
  records::RunRow run = a_run();
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
  EXPECT_EQ(store.runs()[1].provenance.count("clock"), 0U);
}

TEST_F(StoreTest, AllTrialsOfACallAreAddedOrNone) {
  records::Store store(file_);
  const std::int64_t id = begin(store);
  store.add_trial(id, a_trial("before", "b/chair/01", true));
  std::vector<records::TrialRow> trials{a_trial("before", "b/chair/00", true),
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
    records::Store store(file_);
    const std::int64_t id = begin(store);
    store.set_provenance(id, "clock", "lockstep");
    records::TrialRow trial = a_trial("before", "b/chair/00", false);
    trial.distance_to_goal_m.reset();
    trial.error = "line\n\"two\" \xff";
    trial.log = "logs/x.gz";
    trial.why.cause = records::Cause::kStuck;
    trial.why.planar_m = 1.5;
    store.add_trial(id, trial);
    store.add_trial(id, a_trial("after", "b/chair/00", true));
  }
  std::ostringstream out;
  results::write_trials_jsonl(out, results::load_run(folder_.path()));
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
  execute_sql(foreign, "CREATE TABLE recipes (name TEXT)");
  EXPECT_THAT(refusal(foreign), HasSubstr("another SQLite database"));
  const fs::path text = folder_ / "notes.txt";
  std::ofstream(text) << "This is no database, but it is long enough to be taken for one. "
                      << std::string(2000, '.');
  EXPECT_THAT(refusal(text), HasSubstr("notes.txt"));
}

/// SQLite would read on and leave out what it does not find.
TEST_F(StoreTest, ADamagedDatabaseIsRefused) {
  const fs::path file = folder_ / "damaged.sqlite";
  const std::string rows =
      "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 2000) ";
  { const records::Store made(file); }
  const std::string sql = "CREATE TABLE filling (i INTEGER NOT NULL, text TEXT NOT NULL); " +
                          rows +
                          "INSERT INTO filling SELECT i, 'a text that takes room' FROM n; "
                          "PRAGMA wal_checkpoint(TRUNCATE)";
  execute_sql(file, sql.c_str());
  EXPECT_EQ(refusal(file), "");
  fs::resize_file(file, fs::file_size(file) / 2);
  EXPECT_THAT(refusal(file), HasSubstr("damaged.sqlite: expected"));
}

TEST_F(StoreTest, CsvHasNoNaNAndQuotesWhatNeedsIt) {
  records::TrialRow trial = a_trial("before", "b/chair/00", false);
  trial.distance_to_goal_m.reset();
  trial.error = "stuck, \"badly\"";
  std::ostringstream out;
  records::write_trials_csv(out, {trial});
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
