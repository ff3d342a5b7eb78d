#include "experiments/trials/live_view.h"

#include <fstream>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "experiments/dashboard/internal/live_files.h"
#include "experiments/results/stored_run.h"
#include "tests/experiments/dashboard_fixture.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::StartsWith;
using Clock = std::chrono::steady_clock;

/// A policy whose map has 3 x 2 cells.
class MapPolicy final : public core::Policy {
 public:
  void reset(const core::ObjectGoal& /*goal*/, std::uint64_t /*seed*/) override {}
  core::Decision decide(const core::Observation& /*seen*/,
                        std::span<const core::Detection> /*detections*/) override {
    std::this_thread::sleep_for(std::chrono::milliseconds(3));
    return {};
  }
  [[nodiscard]] core::PolicyView view() const override {
    core::PolicyView view;
    view.resolution_m = 0.1;
    view.cells = core::Image<std::uint8_t>(3, 2, 2);
    view.frontiers_m = {{1.0, 2.0}};
    return view;
  }
};

class LiveViewFiles : public testing::Test {
 protected:
  LiveViewFiles() {
    frame_.rgb = core::Image<core::Rgb8>(64, 48, {10, 20, 30});
    frame_.semantic = core::Image<std::uint16_t>(64, 48, 1);
    frame_.instance = core::Image<std::uint16_t>(64, 48, 0);
    frame_.intrinsics.width_px = 64;
    frame_.intrinsics.height_px = 48;
    frame_.stats.render_ms = 7.0;
  }
  void tick(trials::LiveView& live, double x_m) {
    sim::TickRecord record;
    record.pose.x_m = x_m;
    record.mode = core::PolicyMode::kExplore;
    const std::vector<core::Detection> detections{{0, 0.5F, {1, 2, 3, 4}}};
    live.add(record, frame_, detections, policy_);
  }
  [[nodiscard]] trials::LiveTrial trial() const {
    trials::LiveTrial of;
    of.scene = "room";
    of.goal_class = "couch";
    of.episode = "room/\xff/1";  // No UTF-8.
    of.goal_index = 0;
    of.detector_classes = {"couch"};
    return of;
  }
  TemporaryFolder folder_;
  MapPolicy policy_;
  core::Frame frame_;
};

TEST_F(LiveViewFiles, AreOnlyThereWhileSomebodyWatches) {
  {
    trials::LiveView live(folder_.path());
    live.begin(trial());
    for (int k = 0; k < 100; ++k) tick(live, k);
    EXPECT_FALSE(fs::exists(folder_.path() / trials::kLiveFolder));
    EXPECT_EQ(live.spent_s(), 0.0);
  }
  ASSERT_TRUE(dashboard::internal::ask_for_live_files(folder_.path()));
  fs::path file;
  {
    trials::LiveView live(folder_.path());
    live.begin(trial());
    trials::TimedPolicy timed(policy_, live);
    (void)timed.decide({}, {});
    tick(live, 0.0);
    file = live.file();
    ASSERT_TRUE(fs::exists(file));
    const auto workers = dashboard::internal::read_live_files({folder_.path()});
    ASSERT_EQ(workers.size(), 1U);
    const auto json = nlohmann::json::parse(workers[0].header);
    EXPECT_EQ(json["trial"]["goal_class"], "couch");
    EXPECT_EQ(json["tick"]["mode"], "explore");
    EXPECT_EQ(json["detections"][0][0], "couch");
    EXPECT_EQ(json["cells"]["size"], (std::vector<int>{3, 2}));
    EXPECT_EQ(json["stages"][0][2], 7.0);
    EXPECT_GE(json["stages"][0][4], 3.0);  // The policy slept so long.
    const auto part = [&](const char* name) {
      return dashboard::internal::read_live_part({folder_.path()}, workers[0].worker, name)
          .value_or("");
    };
    EXPECT_THAT(part("camera.jpg"), StartsWith("\xff\xd8\xff"));
    EXPECT_THAT(part("panoptic.jpg"), StartsWith("\xff\xd8\xff"));
    EXPECT_THAT(part("cells.png"), StartsWith("\x89PNG"));
  }
  EXPECT_FALSE(fs::exists(file));
}

TEST_F(LiveViewFiles, EndWithTheWatching) {
  ASSERT_TRUE(dashboard::internal::ask_for_live_files(folder_.path()));
  fs::last_write_time(folder_.path() / trials::kLiveFolder / trials::kLiveMarker,
                      fs::file_time_type::clock::now() - std::chrono::seconds(60));
  trials::LiveView live(folder_.path());
  live.begin(trial());
  for (int k = 0; k < 100; ++k) tick(live, k);
  EXPECT_FALSE(fs::exists(live.file()));
}

TEST_F(LiveViewFiles, AFolderThatCannotBeWrittenToIsNoError) {
  ASSERT_TRUE(dashboard::internal::ask_for_live_files(folder_.path()));
  trials::LiveView live(folder_.path());
  live.begin(trial());
  // A folder in the file's place: nobody can rename a file over it, not even root.
  fs::create_directories(live.file() / "in_the_way");
  for (int k = 0; k < 3; ++k) tick(live, k);
  EXPECT_TRUE(fs::is_directory(live.file()));
}

TEST_F(LiveViewFiles, CostLessThanAHundredthOfTheTime) {
  ASSERT_TRUE(dashboard::internal::ask_for_live_files(folder_.path()));
  frame_.rgb = core::Image<core::Rgb8>(640, 480, {10, 20, 30});
  frame_.semantic = core::Image<std::uint16_t>(640, 480, 1);
  frame_.instance = core::Image<std::uint16_t>(640, 480, 0);
  trials::LiveView live(folder_.path());
  live.begin(trial());
  const Clock::time_point start = Clock::now();
  int writes = 0;
  double spent_s = 0.0, largest_s = 0.0;
  while (Clock::now() - start < std::chrono::seconds(4)) {
    tick(live, 0.0);
    if (live.spent_s() > spent_s) {
      ++writes;
      largest_s = std::max(largest_s, live.spent_s() - spent_s);
      spent_s = live.spent_s();
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  const double wall_s = std::chrono::duration<double>(Clock::now() - start).count();
  RecordProperty("writes", writes);
  RecordProperty("share_of_time", std::to_string(spent_s / wall_s));
  RecordProperty("ms_per_write", std::to_string(1e3 * spent_s / std::max(1, writes)));
  EXPECT_GE(writes, 1);
  EXPECT_LE(writes, 1 + static_cast<int>(wall_s / 0.5));
  // The first is written at once, and one may come right before the end.
  EXPECT_LE(spent_s, 0.01 * wall_s + 2.0 * largest_s);
}

TEST(LiveViewOfARun, ChangesNoResult) {
  const TemporaryFolder folder("live_run");
  TinyScene().write(folder.path() / "tiny");
  const auto hashes = [&](const std::string& work, bool watched) {
    runs::RunOptions options;
    options.folders = {folder.path(), folder.path() / work};
    options.workers = 2;
    fs::create_directories(options.folders.work);
    EXPECT_TRUE(!watched || dashboard::internal::ask_for_live_files(options.folders.work));
    (void)runs::run_experiment(tiny_spec(options.folders, 3), options);
    std::vector<std::uint64_t> all;
    for (const records::TrialRow& row : results::load_run(options.folders.work).trials) {
      EXPECT_FALSE(row.failed()) << row.error;
      all.push_back(row.state_hash);
    }
    return all;
  };
  const std::vector<std::uint64_t> plain = hashes("plain", false);
  EXPECT_EQ(plain.size(), 6U);
  EXPECT_FALSE(fs::exists(folder.path() / "plain" / trials::kLiveFolder));
  EXPECT_EQ(hashes("watched", true), plain);
  EXPECT_TRUE(dashboard::internal::read_live_files({folder.path() / "watched"}).empty());
}

}  // namespace
}  // namespace segsim::experiments
