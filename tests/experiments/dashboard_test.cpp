#include "experiments/dashboard/dashboard.h"

#include <atomic>
#include <cstring>
#include <fstream>
#include <set>

#include <gmock/gmock.h>
#include <sqlite3.h>

#include "core/error.h"
#include "core/file_io.h"
#include "dashboard_fixture.h"
#include "experiments/dashboard/internal/http_server.h"
#include "experiments/dashboard/internal/live_files.h"
#include "experiments/dashboard/internal/run_index.h"
#include "experiments/dashboard/internal/run_json.h"
#include "experiments/dashboard/internal/scene_viewer.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

constexpr const char* kToken = "correct-horse-battery";

/// A real run of two trials with bundle and logs, served.
class DashboardOfARun : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("dashboard_run");
    TinyScene().write(folder_->path() / "tiny");
    RunOptions options;
    options.folders = {folder_->path(), folder_->path() / "out" / "work"};
    options.workers = 1;
    (void)run_experiment(tiny_spec(options.folders, 1), options);
    std::ofstream(folder_->path() / "out" / "secret.txt") << "root:secret";
    std::ofstream(folder_->path() / "out" / "work" / "secret.txt") << "root:secret";
    served_ = new ServedFolder(folder_->path() / "out");
    run_ = "/api/runs/" + served_->only_run();
  }
  static void TearDownTestSuite() {
    delete served_;
    delete folder_;
  }
  static TemporaryFolder* folder_;
  static ServedFolder* served_;
  static std::string run_;
};
TemporaryFolder* DashboardOfARun::folder_ = nullptr;
ServedFolder* DashboardOfARun::served_ = nullptr;
std::string DashboardOfARun::run_;

TEST_F(DashboardOfARun, PagesAndTheirFilesAreThere) {
  for (const char* page :
       {"/", "/runs.html", "/run.html?run=x", "/trial.html", "/scene.html"}) {
    const Answer answer = served_->get(page);
    EXPECT_EQ(answer.status, 200) << page;
    EXPECT_THAT(answer.head, HasSubstr("Content-Type: text/html")) << page;
    EXPECT_THAT(answer.body, Not(HasSubstr("://"))) << page;  // Nothing from elsewhere.
    EXPECT_THAT(answer.body, Not(HasSubstr("style="))) << page;
    // Every file that the page wants.
    for (std::size_t at = answer.body.find("/static/"); at != std::string::npos;
         at = answer.body.find("/static/", at + 1)) {
      const std::string file = answer.body.substr(at, answer.body.find('"', at) - at);
      const Answer part = served_->get(file);
      const bool packaged = file.find("three") != std::string::npos ||
                            file.find("Orbit") != std::string::npos ||
                            file.find("chart") != std::string::npos;
      EXPECT_TRUE(part.status == 200 || (packaged && part.status == 404)) << file;
      if (part.status == 200 && file.ends_with(".js")) {
        EXPECT_THAT(part.head, HasSubstr("Content-Type: text/javascript"));
      }
    }
  }
}

TEST_F(DashboardOfARun, TheRunIsTold) {
  const nlohmann::json run = served_->get(run_).json();
  EXPECT_EQ(run["title"], "Two rooms");
  EXPECT_EQ(run["state"], "finished");
  EXPECT_EQ(run["done"], 2);
  EXPECT_EQ(run["planned"], 2);
  EXPECT_EQ(run["arms"].size(), 2U);
  EXPECT_EQ(run["pair"]["p"], 1.0);  // One arm against itself.
  const nlohmann::json trials = served_->get(run_ + "/trials").json();
  EXPECT_EQ(trials["total"], 2);
  EXPECT_EQ(trials["trials"][0]["id"], 2);  // Newest first.
  EXPECT_EQ(served_->get(run_ + "/trials?offset=1").json()["trials"].size(), 1U);
  EXPECT_EQ(served_->get(run_ + "/trials?offset=9").json()["trials"].size(), 0U);
  EXPECT_EQ(served_->get(run_ + "/trials?offset=-1").status, 404);
}

TEST_F(DashboardOfARun, ATrialHasItsTicksAndImages) {
  const nlohmann::json trial = served_->get(run_ + "/trials/1").json();
  const auto ticks = trial["ticks"].size();
  EXPECT_EQ(ticks, trial["trial"]["ticks"]);
  EXPECT_EQ(trial["ticks"][0].size(), 10U);
  EXPECT_EQ(trial["goal_class"], "couch");
  EXPECT_EQ(trial["others"].size(), 2U);
  EXPECT_FALSE(trial["story"].empty());
  for (const char* which : {"camera", "panoptic"}) {
    const Answer first = served_->get(run_ + "/trials/1/" + which + "/0.jpg");
    EXPECT_EQ(first.status, 200);
    EXPECT_THAT(first.body, StartsWith("\xff\xd8\xff"));
    const Answer last =
        served_->get(run_ + "/trials/1/" + which + "/" + std::to_string(ticks - 1) + ".jpg");
    EXPECT_NE(first.body, last.body);
    EXPECT_EQ(served_->get(run_ + "/trials/1/" + which + "/0.jpg").body, first.body);
    const Answer none =
        served_->get(run_ + "/trials/1/" + which + "/" + std::to_string(ticks) + ".jpg");
    EXPECT_EQ(none.status, 404);
    EXPECT_THAT(none.body, HasSubstr("expected 0 to "));
  }
}

TEST_F(DashboardOfARun, AScenePlanAndPointsAgree) {
  const nlohmann::json floor = served_->get(run_ + "/scenes/0/floor.json").json();
  const Answer points = served_->get(run_ + "/scenes/0/points.bin");
  std::uint32_t count = 0;
  std::memcpy(&count, points.body.data(), sizeof count);
  EXPECT_EQ(count, floor["surfels"].get<std::uint32_t>());
  EXPECT_EQ(points.body.size(), 4U + count * (12U + 3U + 3U));
  EXPECT_THAT(served_->get(run_ + "/scenes/0/floor.jpg").body, StartsWith("\xff\xd8\xff"));
  EXPECT_EQ(floor["objects"][0]["class"], "couch");
  EXPECT_EQ(served_->get(run_ + "/scenes/1/floor.json").status, 404);
}

TEST_F(DashboardOfARun, NothingElseIsThere) {
  const std::string key = run_.substr(10);
  for (const std::string& path :
       std::vector<std::string>{"/secret.txt",
                                "/../secret.txt",
                                "/..%2fsecret.txt",
                                "/%2e%2e/secret.txt",
                                "/static/../secret.txt",
                                "/static/..%2f..%2fsecret.txt",
                                "/static/%2e%2e%2fsecret.txt",
                                "/static//etc/passwd",
                                "/static/%2fetc%2fpasswd",
                                "//etc/passwd",
                                "/static/",
                                "/static/runs.html",
                                "/report.css",
                                "/static/chart.min.js%00.css",
                                "/api",
                                "/api/",
                                "/api/runs/" + key + "/secret.txt",
                                "/api/runs/" + key + "/workers/..%2fsecret/x.jpg",
                                "/api/runs/" + key + "/workers/../../secret.txt/x.jpg",
                                "/api/runs/0",
                                "/api/runs/..%2f..",
                                "/api/runs/" + key + "/trials/3",
                                "/api/runs/" + key + "/trials/1e0",
                                "/api/runs/" + key + "/trials/-1",
                                "/api/runs/" + key + "/trials/1/camera/x.jpg",
                                "/api/runs/" + key + "/trials/1/camera/..%2f0.jpg",
                                "/api/runs/" + key + "/trials/1/secret/0.jpg",
                                "/api/runs/" + key + "/trials/99999999999999999999",
                                "/api/runs/" + key + "/scenes/..%2f/floor.json",
                                "/api/runs/" + key + "/scenes/0/scene.yaml",
                                "/results.sqlite",
                                "/out/work/results.sqlite",
                                "/x/y/z/" + std::string(900, 'a')}) {
    const Answer answer = served_->get(path);
    EXPECT_EQ(answer.status, 404) << path;
    EXPECT_THAT(answer.body, Not(HasSubstr("root:"))) << path;
    EXPECT_TRUE(answer.json().contains("error")) << path;
  }
}

TEST_F(DashboardOfARun, OnlyReadsAreAnswered) {
  for (const char* method : {"POST", "PUT", "DELETE", "PATCH", "OPTIONS"}) {
    const Answer answer = served_->ask(method, "/api/runs", "Content-Length: 0\r\n");
    EXPECT_EQ(answer.status, 405) << method;
    EXPECT_THAT(answer.head, HasSubstr("Allow: GET, HEAD\r\n"));
  }
  EXPECT_EQ(served_->ask("BREW", "/").status, 400);
  const Answer head = served_->ask("HEAD", "/");
  EXPECT_EQ(head.status, 200);
  EXPECT_TRUE(head.body.empty());
  const std::string size = "Content-Length: " + std::to_string(served_->get("/").body.size());
  EXPECT_THAT(head.head, HasSubstr(size + "\r\n"));
  // Nonsense neither kills the server nor is answered with a page.
  for (const char* bytes : {"\r\n\r\n", "GET\r\n\r\n", "GET / HTTP/9.9\r\n\r\n",
                            "GET / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n"}) {
    EXPECT_NE(send_raw(served_->port(), bytes).status, 200) << bytes;
  }
  EXPECT_EQ(served_->get("/").status, 200);
}

TEST_F(DashboardOfARun, EveryAnswerForbidsForeignContent) {
  for (const char* path : {"/", "/api/runs", "/static/common.js", "/nothing"}) {
    const Answer answer = served_->get(path);
    EXPECT_THAT(answer.head, HasSubstr("default-src 'none'; script-src 'self'")) << path;
    EXPECT_THAT(answer.head, Not(HasSubstr("unsafe"))) << path;
    EXPECT_THAT(answer.head, HasSubstr("X-Content-Type-Options: nosniff\r\n")) << path;
    EXPECT_THAT(answer.head, HasSubstr("Referrer-Policy: no-referrer\r\n")) << path;
    EXPECT_THAT(answer.head, Not(HasSubstr("Access-Control"))) << path;
  }
}

TEST_F(DashboardOfARun, PagesElsewhereCannotReachIn) {
  for (const char* host : {"localhost", "127.0.0.1:80", "[::1]:8080", "localhost:1"}) {
    EXPECT_EQ(served_->ask("GET", "/api/runs", {}, host).status, 200) << host;
  }
  // A name of somebody else's that was made to point here (DNS rebinding).
  for (const char* host :
       {"evil.example", "evil.example:8080", "localhost.evil.example", ""}) {
    EXPECT_EQ(served_->ask("GET", "/api/runs", {}, host).status, 403) << host;
  }
}

TEST_F(DashboardOfARun, LookingChangesNothing) {
  const fs::path work = folder_->path() / "out" / "work";
  const auto files = [&] {
    std::map<std::string, std::string> all;
    for (const auto& entry : fs::recursive_directory_iterator(work)) {
      const std::string name = entry.path().string();
      // Memory that readers share; SQLite makes it again at will.
      if (name.ends_with("-shm") || name.ends_with("-wal")) continue;
      all[name] = entry.is_regular_file() ? core::sha256_of_file(entry.path()) : "folder";
    }
    return all;
  };
  const auto before = files();
  (void)served_->get("/api/runs");
  (void)served_->get(run_);
  (void)served_->get(run_ + "/trials/2/camera/3.jpg");
  EXPECT_EQ(files(), before);
}

TEST(Dashboard, ATokenIsAskedFor) {
  const TemporaryFolder folder;
  const ServedFolder served(folder.path(), kToken);
  EXPECT_THAT(served.home(), HasSubstr("?token=correct-horse-battery"));
  EXPECT_EQ(served.get("/").status, 401);
  EXPECT_EQ(served.get("/static/common.js").status, 401);
  EXPECT_EQ(served.get("/nothing").status, 401);
  EXPECT_EQ(served.get("/?token=").status, 401);
  EXPECT_EQ(served.get("/?token=correct-horse-batterx").status, 401);
  EXPECT_EQ(served.get("/?token=correct-horse-battery-").status, 401);
  EXPECT_EQ(served.get("/", "Authorization: Bearer wrong\r\n").status, 401);
  EXPECT_EQ(served.get("/", "Authorization: Bearer correct-horse-battery\r\n").status, 200);
  const Answer first = served.get("/?token=correct-horse-battery");
  EXPECT_EQ(first.status, 200);
  const std::string name = "segsim_" + std::to_string(served.port());
  EXPECT_THAT(first.head, HasSubstr("Set-Cookie: " + name +
                                    "=correct-horse-battery; Path=/; "
                                    "HttpOnly; SameSite=Strict\r\n"));
  EXPECT_EQ(served.get("/", "Cookie: a=b; " + name + "=correct-horse-battery\r\n").status,
            200);
  EXPECT_EQ(served.get("/", "Cookie: " + name + "=correct-horse\r\n").status, 401);
  EXPECT_THAT(served.get("/api/runs").body, HasSubstr("expected the token"));
}

TEST(Dashboard, TokensAreComparedWhole) {
  EXPECT_TRUE(internal::equal_tokens("abc", "abc"));
  EXPECT_TRUE(internal::equal_tokens("", ""));
  for (const char* other : {"", "a", "ab", "abd", "xbc", "abca", "abcabc"}) {
    EXPECT_FALSE(internal::equal_tokens(other, "abc")) << other;
    EXPECT_FALSE(internal::equal_tokens("abc", other)) << other;
  }
  for (const char* host : {"127.0.0.1", "127.1.2.3", "localhost", "::1"}) {
    EXPECT_TRUE(internal::is_loopback(host)) << host;
  }
  for (const char* host : {"0.0.0.0", "::", "192.168.0.1", "128.0.0.1", "example.org", ""}) {
    EXPECT_FALSE(internal::is_loopback(host)) << host;
  }
}

std::string refusal_of(const DashboardOptions& options) {
  try {
    const Dashboard dashboard(options);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "served";
}

TEST(Dashboard, BadOptionsAreRefused) {
  const TemporaryFolder folder;
  DashboardOptions options;
  options.port = 0;
  options.roots = {folder.path()};
  EXPECT_EQ(refusal_of(options), "served");
  options.host = "0.0.0.0";
  EXPECT_THAT(refusal_of(options), HasSubstr("--token: expected at least 12"));
  options.token = "short";
  EXPECT_THAT(refusal_of(options), HasSubstr("found 5 characters"));
  options.token = "with a space\r\nand a line";
  EXPECT_THAT(refusal_of(options), HasSubstr("--token"));
  options.token = kToken;
  EXPECT_EQ(refusal_of(options), "served");

  options = {};
  options.roots = {folder.path() / "none"};
  EXPECT_THAT(refusal_of(options), HasSubstr("none: expected a folder of runs"));
  options.roots = {folder.path()};
  options.host = "192.0.2.1";  // An address for examples: nobody's.
  options.token = kToken;
  EXPECT_THAT(refusal_of(options), HasSubstr("expected an address of this machine"));

  const ServedFolder first(folder.path());
  options = {};
  options.roots = {folder.path()};
  options.port = first.port();
  EXPECT_THAT(refusal_of(options), HasSubstr("a port that is free"));
}

TEST(Dashboard, FollowsAStoreThatIsBeingWritten) {
  const TemporaryFolder folder;
  const ServedFolder served(folder.path());
  EXPECT_TRUE(served.get("/api/runs").json()["runs"].empty());
  constexpr int kEpisodes = 40;
  std::atomic<bool> seen{false};
  std::thread writer([&] {
    Store store(folder.path() / "deep" / "work" / "results.sqlite");
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
  Store store(folder.path() / "results.sqlite");
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
  Store whole(work / "results.sqlite");
  const std::int64_t merged = begin_made_up_run(whole, kEpisodes);
  for (int part = 0; part < 2; ++part) {
    Store store(work / "shards" / (std::to_string(part) + "-of-2") / "results.sqlite");
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
    auto run = std::make_shared<internal::RunSnapshot>();
    run->stored.folder = folder;
    run->stored.run.started = "2026-01-31T12:00:00Z";
    TrialRow trial = made_up_trial(episode, "after");
    trial.trial_id = 7;
    trial.log = "logs/x.json.gz";
    if (failed) trial.outcome = "error";
    run->stored.trials = {trial};
    run->finish_times = {"2026-01-31T12:00:0" + std::to_string(episode) + "Z"};
    return run;
  };
  const internal::RunPointer both = internal::combined_run(
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
  { const Store store(folder.path() / "results.sqlite"); }
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open((folder.path() / "results.sqlite").c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "UPDATE meta SET schema_version = 1", nullptr, nullptr, nullptr),
            SQLITE_OK);
  sqlite3_close(db);
  std::ofstream(folder.path() / "other.sqlite") << "no database at all, but long enough";
  const ServedFolder served(folder.path());
  EXPECT_THAT(served.get("/api/runs").json()["problems"].dump(),
              HasSubstr("found version 1 (`segsim table` brings it up to date)"));
  EXPECT_THROW((void)Store::for_reading(folder.path() / "other.sqlite"), core::InputError);
  EXPECT_THROW((void)Store::for_reading(folder.path() / "none.sqlite"), core::InputError);
}

TEST(DashboardPace, IsThatOfTheLastTrialsWithoutPauses) {
  using internal::pace_of;
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
  for (const auto& file : internal::read_live_files({folder.path()}))
    names.push_back(file.worker);
  EXPECT_THAT(names, ElementsAre("good", "odd", "short"));
  const auto part = [&](const std::string& worker, const std::string& name) {
    return internal::read_live_part({folder.path()}, worker, name).value_or("none");
  };
  EXPECT_EQ(part("good", "camera.jpg"), "abc");
  EXPECT_EQ(part("good", "cells.png"), "de");
  EXPECT_EQ(part("good", "panoptic.jpg"), "none");
  EXPECT_EQ(part("short", "camera.jpg"), "none");
  EXPECT_EQ(part("odd", "camera.jpg"), "none");
  EXPECT_EQ(part("../live/good", "camera.jpg"), "none");
  EXPECT_EQ(part("none", "camera.jpg"), "none");
  EXPECT_TRUE(internal::ask_for_live_files(folder.path()));
  EXPECT_FALSE(internal::ask_for_live_files(folder.path() / "none" / "none"));
}

TEST(DashboardPoints, AreThinnedEvenly) {
  const TinyScene scene;
  const std::string bytes = internal::point_bytes(scene.surfels(), 100);
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
  EXPECT_EQ(internal::point_bytes(faint).size(), 4U);
}

}  // namespace
}  // namespace segsim::experiments
