#pragma once

/// @file
/// What the tests of the store share: a file of its own, and a run to put into it.

#include <cstdint>
#include <filesystem>
#include <string>

#include <gtest/gtest.h>
#include <sqlite3.h>

#include "core/error.h"
#include "experiments/records/store.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {

/// A file in a folder of its own.
class StoreTest : public testing::Test {
 protected:
  tests::TemporaryFolder folder_{"store"};
  std::filesystem::path file_ = folder_ / "results.sqlite";
};

/// What no Store does to a file.
inline void execute_sql(const std::filesystem::path& file, const char* sql) {
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &db), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(db, sql, nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
  sqlite3_close(db);
}

inline records::RunRow a_run() {
  records::RunRow run;
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

inline std::int64_t begin(records::Store& store) {
  return store.begin_run(
      a_run(), {{"b", "Scene B", "s1", "e1", 2}, {"a", "Scene A", "s2", "e2", 2}},
      {{"before", "w.bin", "ff", "", -1, {}},
       {"after", "v.bin", "fe", "b", 0.5,
        records::HeldOutPrecision{60, 0.5, 0.25, 0.2, 0.75, 0.625, 0.625, 0.0},
        records::StartLeak{400, 3, 1.0},
        records::SceneExposure{{"b"}, {"b", "a"}, {}, records::TrainingDataKnown::kPart}}});
}

inline records::TrialRow a_trial(const std::string& arm, const std::string& episode,
                                 bool success) {
  records::TrialRow trial;
  trial.arm = arm;
  trial.scene = episode.substr(0, 1);
  trial.episode = episode;
  trial.goal_class = "chair";
  trial.outcome = success ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
  trial.success = success;
  trial.spl = success ? 0.5 : 0.0;
  trial.path_m = 3.25;
  trial.distance_to_goal_m = 0.125;
  trial.ticks = 17;
  trial.state_hash = 0xfedcba9876543210ULL;
  return trial;
}

/// The message with which a database is refused.
inline std::string refusal(const std::filesystem::path& file) {
  try {
    const records::Store store(file);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return {};
}

}  // namespace segsim::experiments
