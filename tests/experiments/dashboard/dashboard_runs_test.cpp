// What the dashboard makes of stores, live files and scenes.
#include "experiments/dashboard/dashboard.h"

#include <atomic>
#include <cstring>
#include <fstream>
#include <set>

#include <gmock/gmock.h>
#include <sqlite3.h>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/dashboard/internal/live_files.h"
#include "experiments/dashboard/internal/run_index.h"
#include "experiments/dashboard/internal/run_json.h"
#include "experiments/dashboard/internal/scene_viewer.h"
#include "tests/experiments/dashboard_fixture.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(Dashboard, FollowsAStoreThatIsBeingWritten) {
  const TemporaryFolder folder;
  const ServedFolder served(folder.path());
  EXPECT_TRUE(served.get("/api/runs").json()["runs"].empty());
  constexpr int kEpisodes = 40;
  std::atomic<bool> seen{false};
  std::thread writer([&] {
    records::Store store(folder.path() / "deep" / "work" / "results.sqlite");
    const std::int64_t id = begin_made_up_run(store, kEpisodes);
    for (int k = 0; k < kEpisodes; ++k) {
      for (const char* arm : {"before", "after"}) store.add_trial(id, made_up_trial(k, arm));
      ::usleep(20'000);
      // The second half once the first was looked at, however slow the machine is.
      for (int wait = 0; k == kEpisodes / 2 && !seen && wait < 600; ++wait) ::usleep(50'000);
    }
  });
  int last = 0, polls_between = 0;
  for (int polls = 0; polls < 2000 && last < 2 * kEpisodes; ++polls) {
    const Answer answer = served.get("/api/runs");
    ASSERT_EQ(answer.status, 200) << answer.body;
    const nlohmann::json all = answer.json();
    EXPECT_TRUE(all["problems"].empty()) << all["problems"];
    if (!all["runs"].empty()) {
      const int now = all["runs"][0]["done"];
      EXPECT_GE(now, last);
      polls_between += now > last && now < 2 * kEpisodes ? 1 : 0;
      last = now;
      seen = last > 0;
    }
    ::usleep(20'000);
  }
  writer.join();
  EXPECT_EQ(last, 2 * kEpisodes);
  EXPECT_GE(polls_between, 1);  // It was seen growing.

  // 32 of 40 against 8 of 40: reference values of Wilson's interval and of the exact test.
  const nlohmann::json run = served.get("/api/runs").json()["runs"][0];
  EXPECT_EQ(run["state"], "finished");
  EXPECT_EQ(run["arms"][1]["successes"], 32);
  EXPECT_NEAR(run["arms"][1]["interval"][0], 0.6524, 1e-4);
  EXPECT_NEAR(run["arms"][1]["interval"][1], 0.8950, 1e-4);
  EXPECT_EQ(run["pair"]["gained"], 24);
  EXPECT_EQ(run["pair"]["lost"], 0);
  EXPECT_NEAR(run["pair"]["p"], std::pow(2.0, -23), 1e-12);
}

TEST(Dashboard, AnUnfinishedRunIsInterim) {
  const TemporaryFolder folder;
  records::Store store(folder.path() / "results.sqlite");
  const std::int64_t id = begin_made_up_run(store, 4);
  store.add_trial(id, made_up_trial(0, "before"));
  const ServedFolder served(folder.path() / "results.sqlite");
  const std::string key = served.only_run();
  const nlohmann::json run = served.get("/api/runs/" + key).json();
  EXPECT_EQ(run["state"], "running");  // A trial finished just now.
  EXPECT_TRUE(run["interim"]);
  EXPECT_TRUE(run["pair"].is_null());
  EXPECT_TRUE(run["can_ask"]);
  EXPECT_TRUE(fs::exists(folder.path() / "live" / "watched"));
  EXPECT_EQ(served.get("/api/runs/" + key + "/trials/1").status, 404);  // It has no log.
  EXPECT_EQ(served.get("/api/runs/" + key + "/scenes/0/floor.json").status, 404);
}

TEST(Dashboard, ShardsAreOneRun) {
  const TemporaryFolder folder;
  const fs::path work = folder.path() / "work";
  constexpr int kEpisodes = 10;
  records::Store whole(work / "results.sqlite");
  const std::int64_t merged = begin_made_up_run(whole, kEpisodes);
  for (int part = 0; part < 2; ++part) {
    records::Store store(work / "shards" / (std::to_string(part) + "-of-2") /
                         "results.sqlite");
    const std::int64_t id = begin_made_up_run(store, kEpisodes);
    for (int k = part; k < kEpisodes - 1; k += 2) {
      for (const char* arm : {"before", "after"}) store.add_trial(id, made_up_trial(k, arm));
    }
    store.end_run(id);
  }
  const ServedFolder served(folder.path());
  const std::string key = served.only_run();
  const auto run = [&] { return served.get("/api/runs/" + key).json(); };
  EXPECT_EQ(run()["done"], 18);
  EXPECT_EQ(run()["planned"], 20);
  EXPECT_EQ(run()["folder"], work.string());
  EXPECT_TRUE(run()["interim"]);  // That both parts have ended says nothing.
  EXPECT_TRUE(fs::exists(work / "shards" / "1-of-2" / "live" / "watched"));
  const nlohmann::json trials = served.get("/api/runs/" + key + "/trials").json();
  std::set<int> ids;
  for (const auto& trial : trials["trials"]) ids.insert(trial["id"].get<int>());
  EXPECT_EQ(ids.size(), 18U);

  // Merging doubles nothing; a trial that failed in a part and succeeded here counts once.
  for (int k = 0; k < kEpisodes; ++k) {
    for (const char* arm : {"before", "after"}) whole.add_trial(merged, made_up_trial(k, arm));
  }
  for (int polls = 0; polls < 200 && run()["done"] != 20; ++polls) ::usleep(50'000);
  EXPECT_EQ(run()["done"], 20);
  EXPECT_EQ(run()["failed"], 0);
  EXPECT_EQ(run()["arms"][1]["successes"], 8);
  EXPECT_EQ(run()["pair"]["pairs"], 10);
}

TEST(DashboardShards, FinishedTrialsComeBeforeFailedOnes) {
  const auto part = [](const char* folder, int episode, bool failed) {
    auto run = std::make_shared<dashboard::internal::RunSnapshot>();
    run->stored.folder = folder;
    run->stored.run.started = "2026-01-31T12:00:00Z";
    records::TrialRow trial = made_up_trial(episode, "after");
    trial.trial_id = 7;
    trial.log = "logs/x.json.gz";
    if (failed) trial.outcome = records::TrialOutcome::kError;
    run->stored.trials = {trial};
    run->finish_times = {"2026-01-31T12:00:0" + std::to_string(episode) + "Z"};
    return run;
  };
  const dashboard::internal::RunPointer both = dashboard::internal::combined_run(
      "/work", nullptr,
      {part("/work/shards/0-of-3", 1, true), part("/work/shards/1-of-3", 1, false),
       part("/work/shards/2-of-3", 2, true)});
  ASSERT_EQ(both->stored.trials.size(), 2U);
  EXPECT_FALSE(both->stored.trials[0].failed());
  EXPECT_EQ(both->stored.trials[0].log, "shards/1-of-3/logs/x.json.gz");
  EXPECT_TRUE(both->stored.trials[1].failed());
  EXPECT_NE(both->stored.trials[0].trial_id, both->stored.trials[1].trial_id);
  EXPECT_EQ(both->finish_times.front(), "2026-01-31T12:00:02Z");
}

TEST(Dashboard, OlderDatabasesAreLeftAsTheyAre) {
  const TemporaryFolder folder;
  { const records::Store store(folder.path() / "results.sqlite"); }
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open((folder.path() / "results.sqlite").c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "UPDATE meta SET schema_version = 1", nullptr, nullptr, nullptr),
            SQLITE_OK);
  sqlite3_close(db);
  std::ofstream(folder.path() / "other.sqlite") << "no database at all, but long enough";
  const ServedFolder served(folder.path());
  EXPECT_THAT(served.get("/api/runs").json()["problems"].dump(),
              HasSubstr("found version 1 (`segsim table` brings it up to date)"));
  EXPECT_THROW((void)records::Store::for_reading(folder.path() / "other.sqlite"),
               core::InputError);
  EXPECT_THROW((void)records::Store::for_reading(folder.path() / "none.sqlite"),
               core::InputError);
}

TEST(DashboardPace, IsThatOfTheLastTrialsWithoutPauses) {
  using dashboard::internal::pace_of;
  const auto at = [](int minute, int second) {
    char text[32];
    std::snprintf(text, sizeof text, "2026-01-31T12:%02d:%02dZ", minute, second);
    return std::string(text);
  };
  EXPECT_EQ(pace_of({}, at(0, 0)).trials_per_s, 0.0);
  EXPECT_EQ(pace_of({}, at(0, 0)).since_last_s, -1.0);
  EXPECT_EQ(pace_of({at(1, 0)}, at(1, 7)).since_last_s, 7.0);
  EXPECT_EQ(pace_of({at(1, 0)}, at(1, 7)).trials_per_s, 0.0);
  EXPECT_DOUBLE_EQ(pace_of({at(1, 20), at(1, 10), at(1, 0)}, at(2, 0)).trials_per_s, 0.1);
  // Yesterday's trials say nothing about today's pace.
  EXPECT_DOUBLE_EQ(
      pace_of({at(50, 20), at(50, 10), at(1, 0), at(0, 59)}, at(51, 0)).trials_per_s, 0.1);
  EXPECT_EQ(pace_of({at(1, 0), at(1, 0), at(1, 0)}, at(1, 0)).trials_per_s, 0.0);
  EXPECT_EQ(pace_of({"nonsense"}, at(1, 0)).since_last_s, -1.0);
}

TEST(DashboardLive, FilesThatAreNoneAreLeftOut) {
  const TemporaryFolder folder;
  fs::create_directories(folder.path() / "live");
  const auto write = [&](const std::string& name, const std::string& text) {
    std::ofstream(folder.path() / "live" / name, std::ios::binary) << text;
  };
  const std::string good =
      R"({"schema":"segsim.live/1","parts":[["camera.jpg",3],["cells.png",2]]})";
  write("good.live", good + "\nabcde");
  write("short.live", R"({"schema":"segsim.live/1","parts":[["camera.jpg",30]]})"
                      "\nabc");
  write("schema.live", R"({"schema":"segsim.live/2","parts":[]})"
                       "\n");
  write("text.live", "no JSON\n");
  write("empty.live", "");
  write("list.live", "[1]\n");
  write("odd.live", R"({"schema":"segsim.live/1","parts":[["camera.jpg",-3],7]})"
                    "\nabc");
  write(".good.tmp1.live", good + "\nabcde");
  write("good.txt", good + "\nabcde");
  std::vector<std::string> names;
  for (const auto& file : dashboard::internal::read_live_files({folder.path()}))
    names.push_back(file.worker);
  EXPECT_THAT(names, ElementsAre("good", "odd", "short"));
  const auto part = [&](const std::string& worker, const std::string& name) {
    return dashboard::internal::read_live_part({folder.path()}, worker, name).value_or("none");
  };
  EXPECT_EQ(part("good", "camera.jpg"), "abc");
  EXPECT_EQ(part("good", "cells.png"), "de");
  EXPECT_EQ(part("good", "panoptic.jpg"), "none");
  EXPECT_EQ(part("short", "camera.jpg"), "none");
  EXPECT_EQ(part("odd", "camera.jpg"), "none");
  EXPECT_EQ(part("../live/good", "camera.jpg"), "none");
  EXPECT_EQ(part("none", "camera.jpg"), "none");
  EXPECT_TRUE(dashboard::internal::ask_for_live_files(folder.path()));
  EXPECT_FALSE(dashboard::internal::ask_for_live_files(folder.path() / "none" / "none"));
}

TEST(DashboardPoints, AreThinnedEvenly) {
  const TinyScene scene;
  const std::string bytes = dashboard::internal::point_bytes(scene.surfels(), 100);
  EXPECT_EQ(bytes.size(), 4U + 100U * 18U);
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data(), sizeof count);
  EXPECT_EQ(count, 100U);
  float xyz[3] = {};
  std::memcpy(xyz, bytes.data() + 4, sizeof xyz);
  EXPECT_EQ(xyz[0], scene.surfels().position_m[0].x);  // The first, then every n-th.
  std::memcpy(xyz, bytes.data() + 4 + 12 * 99, sizeof xyz);
  const std::size_t last = 99 * scene.surfels().size() / 100;
  EXPECT_EQ(xyz[1], scene.surfels().position_m[last].y);
  renderer::SurfelCloud faint = scene.surfels();
  for (float& opacity : faint.opacity) opacity = 0.01F;
  EXPECT_EQ(dashboard::internal::point_bytes(faint).size(), 4U);
}

}  // namespace
}  // namespace segsim::experiments
