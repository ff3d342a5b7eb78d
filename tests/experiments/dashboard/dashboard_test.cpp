#include "experiments/dashboard/dashboard.h"

#include <cstring>
#include <fstream>

#include <gmock/gmock.h>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/web/http_server.h"
#include "tests/experiments/dashboard_fixture.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

constexpr const char* kToken = "correct-horse-battery-staple";

/// A real run of two trials with bundle and logs, served.
class DashboardOfARun : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("dashboard_run");
    TinyScene().write(folder_->path() / "tiny");
    runs::RunOptions options;
    options.folders = {folder_->path(), folder_->path() / "out" / "work"};
    options.workers = 1;
    (void)runs::run_experiment(tiny_spec(options.folders, 1), options);
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
  EXPECT_THAT(served.home(), HasSubstr("?token=correct-horse-battery-staple"));
  EXPECT_EQ(served.get("/").status, 401);
  EXPECT_EQ(served.get("/static/common.js").status, 401);
  EXPECT_EQ(served.get("/nothing").status, 401);
  EXPECT_EQ(served.get("/?token=").status, 401);
  EXPECT_EQ(served.get("/?token=correct-horse-battery-staplx").status, 401);
  EXPECT_EQ(served.get("/?token=correct-horse-battery-staple-").status, 401);
  EXPECT_EQ(served.get("/", "Authorization: Bearer wrong\r\n").status, 401);
  EXPECT_EQ(served.get("/", "Authorization: Bearer correct-horse-battery-staple\r\n").status,
            200);
  const Answer first = served.get("/?token=correct-horse-battery-staple");
  EXPECT_EQ(first.status, 200);
  const std::string name = "segsim_" + std::to_string(served.port());
  EXPECT_THAT(first.head, HasSubstr("Set-Cookie: " + name +
                                    "=correct-horse-battery-staple; Path=/; "
                                    "HttpOnly; SameSite=Strict\r\n"));
  EXPECT_EQ(
      served.get("/", "Cookie: a=b; " + name + "=correct-horse-battery-staple\r\n").status,
      200);
  EXPECT_EQ(served.get("/", "Cookie: " + name + "=correct-horse\r\n").status, 401);
  EXPECT_THAT(served.get("/api/runs").body, HasSubstr("expected the token"));
}

TEST(Dashboard, TokensAreComparedWhole) {
  EXPECT_TRUE(web::equal_tokens("abc", "abc"));
  EXPECT_TRUE(web::equal_tokens("", ""));
  for (const char* other : {"", "a", "ab", "abd", "xbc", "abca", "abcabc"}) {
    EXPECT_FALSE(web::equal_tokens(other, "abc")) << other;
    EXPECT_FALSE(web::equal_tokens("abc", other)) << other;
  }
  for (const char* host : {"127.0.0.1", "127.1.2.3", "localhost", "::1"}) {
    EXPECT_TRUE(web::is_loopback(host)) << host;
  }
  for (const char* host : {"0.0.0.0", "::", "192.168.0.1", "128.0.0.1", "example.org", ""}) {
    EXPECT_FALSE(web::is_loopback(host)) << host;
  }
}

std::string refusal_of(const dashboard::DashboardOptions& options) {
  try {
    const dashboard::Dashboard dashboard(options);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "served";
}

TEST(Dashboard, BadOptionsAreRefused) {
  const TemporaryFolder folder;
  dashboard::DashboardOptions options;
  options.port = 0;
  options.roots = {folder.path()};
  EXPECT_EQ(refusal_of(options), "served");
  options.host = "0.0.0.0";
  EXPECT_EQ(refusal_of(options), "served") << "with a token that is made up";
  options.token = "short";
  EXPECT_THAT(refusal_of(options), HasSubstr("--token: expected at least 22"));
  EXPECT_THAT(refusal_of(options), HasSubstr("found 5 characters"));
  options.token = std::string(40, 'a') + "bcd";
  EXPECT_THAT(refusal_of(options), HasSubstr("4 of them different"));
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

}  // namespace
}  // namespace segsim::experiments
