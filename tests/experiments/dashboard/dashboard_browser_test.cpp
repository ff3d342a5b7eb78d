// The dashboard's pages in a real browser.
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <sstream>

#include <gmock/gmock.h>

#include "experiments/support/stop_signal.h"
#include "experiments/trials/live_view.h"
#include "perception/data/image_file.h"
#include "tests/experiments/browser.h"
#include "tests/experiments/dashboard_fixture.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::IsEmpty;
using tests::browse;
using tests::Browsed;

/// Of the page's own clock: enough for a hundred polls and more.
constexpr int kManyPolls_ms = 200'000;

/// What the page complains of. The software WebGL of a machine without a GPU is slow, and says
/// so whenever a picture is taken.
std::vector<std::string> complaints(const Browsed& browsed) {
  std::vector<std::string> lines;
  std::istringstream log(browsed.log);
  for (std::string line; std::getline(log, line);) {
    if (line.find(":CONSOLE") == std::string::npos) continue;
    if (line.find("GL Driver Message (OpenGL, Performance") != std::string::npos) continue;
    lines.push_back(line);
  }
  return lines;
}

class DashboardInABrowser : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (!tests::has_browser()) return;
    folder_ = new TemporaryFolder("dashboard_browser");
    TinyScene().write(folder_->path() / "tiny");
    runs::RunOptions options;
    options.folders = {folder_->path(), folder_->path() / "out" / "work"};
    options.workers = 1;
    (void)runs::run_experiment(tiny_spec(options.folders, 2), options);
    served_ = new ServedFolder(folder_->path() / "out");
    run_ = served_->only_run();
  }
  static void TearDownTestSuite() {
    delete served_;
    delete folder_;
  }
  void SetUp() override {
    if (!tests::has_browser()) {
      GTEST_SKIP() << "no chromium on this machine (Debian: apt-get install chromium)";
    }
  }
  static TemporaryFolder* folder_;
  static ServedFolder* served_;
  static std::string run_;
};
TemporaryFolder* DashboardInABrowser::folder_ = nullptr;
ServedFolder* DashboardInABrowser::served_ = nullptr;
std::string DashboardInABrowser::run_;

TEST_F(DashboardInABrowser, EveryPageLoadsWithoutAnError) {
  const std::pair<std::string, const char*> pages[] = {
      {"/", "4 of 4"},
      {"/run.html?run=" + run_, "tiny/couch/"},
      {"/trial.html?run=" + run_ + "&trial=1#3", "Find a couch in Two rooms"},
      {"/scene.html?run=" + run_ + "&trial=1", "surfels, as points"}};
  for (const auto& [page, text] : pages) {
    const Browsed browsed = browse(served_->address(page), folder_->path());
    EXPECT_THAT(browsed.dom, HasSubstr("data-ready=\"1\"")) << page << browsed.log;
    EXPECT_THAT(browsed.dom, HasSubstr(text)) << page;
    EXPECT_THAT(complaints(browsed), IsEmpty()) << page;
  }
}

TEST_F(DashboardInABrowser, UnknownRunsAndTrialsAreSaid) {
  const Browsed none = browse(served_->address("/trial.html?run=x&trial=1"), folder_->path());
  EXPECT_THAT(none.dom, HasSubstr("no such run"));
  const Browsed scene = browse(served_->address("/scene.html?run=x"), folder_->path());
  EXPECT_THAT(scene.dom, HasSubstr("no such run"));
}

TEST_F(DashboardInABrowser, ATrialShowsTheTickThatItsAddressNames) {
  const Browsed browsed =
      browse(served_->address("/trial.html?run=" + run_ + "&trial=1#3"), folder_->path());
  EXPECT_THAT(browsed.dom, HasSubstr("tick 3 of "));
  EXPECT_THAT(browsed.dom, HasSubstr("/trials/1/camera/3.jpg"));
  EXPECT_THAT(browsed.dom, HasSubstr("/trials/1/panoptic/3.jpg"));
}

/// Mean over the pixels and channels, and how far they spread.
std::pair<double, double> spread_of(const core::Image<core::Rgb8>& image) {
  double sum = 0, squares = 0;
  for (const core::Rgb8& p : image.pixels()) {
    for (const double v : {double(p.r), double(p.g), double(p.b)}) {
      sum += v;
      squares += v * v;
    }
  }
  const double n = 3.0 * static_cast<double>(image.size());
  return {sum / n, std::sqrt(squares / n - sum / n * (sum / n))};
}

TEST_F(DashboardInABrowser, ScreenshotsAreNotBlank) {
  // Kept where the caller wants to look at them.
  const char* keep = std::getenv("SEGSIM_SCREENSHOTS");
  const fs::path shots = keep != nullptr ? fs::path(keep) : folder_->path();
  const std::pair<const char*, std::string> pages[] = {
      {"runs.png", "/"},
      {"run.png", "/run.html?run=" + run_},
      {"trial.png", "/trial.html?run=" + run_ + "&trial=1#20"},
      {"scene.png", "/scene.html?run=" + run_ + "&trial=1"}};
  for (const auto& [name, page] : pages) {
    fs::remove(shots / name);
    (void)browse(served_->address(page), folder_->path(), 10000, shots / name);
    ASSERT_TRUE(fs::exists(shots / name)) << page;
    const auto [mean, deviation] = spread_of(perception::read_image(shots / name));
    EXPECT_GT(deviation, 5.0) << page;
  }
}

TEST_F(DashboardInABrowser, APageFollowsARunThatIsWritten) {
  const TemporaryFolder work("dashboard_follow");
  records::Store store(work.path() / "results.sqlite");
  const std::int64_t id = begin_made_up_run(store, 10);
  store.add_trial(id, made_up_trial(0, "before"));
  store.add_trial(id, made_up_trial(0, "after"));
  const ServedFolder served(work.path());
  std::atomic<bool> stop{false};
  std::thread writer([&] {
    // Only once the page has asked for the first time: the marker says so.
    while (!fs::exists(work.path() / trials::kLiveFolder / trials::kLiveMarker) && !stop)
      ::usleep(5'000);
    for (int k = 1; k < 9 && !stop; ++k) {
      for (const char* arm : {"before", "after"}) store.add_trial(id, made_up_trial(k, arm));
    }
  });
  const Browsed browsed = browse(served.address("/"), folder_->path(), kManyPolls_ms);
  stop = true;
  writer.join();
  EXPECT_THAT(browsed.dom, HasSubstr("18 of 20"));
  EXPECT_THAT(browsed.dom, HasSubstr("interim"));
  EXPECT_THAT(browsed.dom, HasSubstr("Demo &lt;b&gt;&amp;"));  // A name is never markup.
  EXPECT_THAT(complaints(browsed), IsEmpty());
}

TEST_F(DashboardInABrowser, ShowsWhatAWorkerOfARunningRunSees) {
  runs::RunOptions options;
  options.folders = {folder_->path(), folder_->path() / "running"};
  options.workers = 1;
  options.prepare_only = true;
  const specs::ExperimentSpec spec = tiny_spec(options.folders, 40);
  (void)runs::run_experiment(spec, options);
  const ServedFolder served(folder_->path() / "running");
  const std::string key = served.only_run();  // Asks for pictures by looking.
  std::thread run([&] {
    options.prepare_only = false;
    (void)runs::run_experiment(spec, options);
  });
  const char* keep = std::getenv("SEGSIM_SCREENSHOTS");
  const Browsed browsed =
      browse(served.address("/run.html?run=" + key), folder_->path(), kManyPolls_ms);
  if (keep != nullptr) {
    (void)browse(served.address("/run.html?run=" + key), folder_->path(), kManyPolls_ms,
                 fs::path(keep) / "live.png", "1400,1400");
  }
  support::StopOnSignal::request();
  run.join();
  EXPECT_THAT(browsed.dom, HasSubstr("camera.jpg?tick=")) << browsed.dom;
  EXPECT_THAT(browsed.dom, HasSubstr("panoptic.jpg?tick="));
  EXPECT_THAT(browsed.dom, HasSubstr("find a couch"));
  EXPECT_THAT(complaints(browsed), IsEmpty());
}

}  // namespace
}  // namespace segsim::experiments
