#include "experiments/records/store.h"

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
#include "experiments/results/trial_export.h"
#include "store_fixture.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
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
  EXPECT_FALSE(store.arms(id)[0].exposure.has_value());
  EXPECT_EQ(store.arms(id)[1].exposure,
            (SceneExposure{{"b"}, {"b", "a"}, {}, TrainingDataKnown::kPart}));
  EXPECT_EQ(run.provenance.at("leakage/after"),
            "partly unknown; trained on b; threshold chosen on b, a");
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
  trial.why.misplaced_clouds = 13;
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
      why.inevitable_tick,  why.decisive_tick,    why.visible_frames,  why.detected_frames,
      why.true_detections,  why.false_detections, why.first_true_tick, why.true_clouds,
      why.false_clouds,     why.final_visible_px, why.collision_ticks, why.off_navmesh_ticks,
      why.reached_instance, why.images,           why.misplaced_clouds};
  EXPECT_EQ(numbers, (std::vector<int>{16, 9, 5, 4, 6, 7, 3, 1, 2, 77, 8, 11, 12, 40, 13}));
  EXPECT_TRUE(why.stopped);
  EXPECT_EQ(why.object_m, 0.0);
  EXPECT_FALSE(why.planar_m.has_value());
  EXPECT_EQ(why.shortest_object_m, 4.5);
  EXPECT_FALSE(rows[1].why.known());
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
  EXPECT_EQ(store.runs()[1].provenance.count("clock"), 0U);
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
  write_trials_jsonl(out, load_run(folder_.path()));
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
