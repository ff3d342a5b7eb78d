// `segsim table 1` from end to end, as small as it goes.
#include "experiments/panoptic/panoptic_run.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <thread>

#include <gmock/gmock.h>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/panoptic/panoptic_table.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

panoptic::PanopticRunOptions tiny_options(const fs::path& work) {
  panoptic::PanopticRunOptions options;
  options.scenes = panoptic::panoptic_scenes("flat-3", "").scenes;
  options.heads = {"query", "panoptic-lifting"};
  options.mask_level = 1.0;
  options.device.threads = 1;
  options.work = work;
  panoptic::make_quick(options);
  options.config.panoptic.iterations = 40;
  return options;
}

std::string table_text(const std::vector<panoptic::SceneFigures>& results) {
  panoptic::PanopticTable table;
  table.results = results;
  table.rules = panoptic::panoptic_rule_names();
  table.planned = static_cast<int>(results.size());
  return panoptic::format_panoptic_table(table, support::TableFormat::kJson);
}

TEST(PanopticRun, KilledAndResumedGivesTheSameTable) {
  const TemporaryFolder folder("panoptic_run");
  panoptic::PanopticRunOptions options = tiny_options(folder.path() / "killed");
  const fs::path first = options.work / "flat-3" / "query.json";
  // The child first: a fork must not happen beside threads.
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    (void)panoptic::run_panoptic_scenes(options);
    ::_exit(0);
  }
  int status = 0;
  bool ended = false;  // Before its first result: a failure, not a reason to wait.
  while (!fs::exists(first) && !ended) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    ended = ::waitpid(child, &status, WNOHANG) == child;
  }
  if (!ended) {
    ::kill(child, SIGKILL);
    ASSERT_EQ(::waitpid(child, &status, 0), child);
  }
  ASSERT_TRUE(fs::exists(first));
  const auto kept = fs::last_write_time(first);
  const auto surfels = fs::last_write_time(options.work / "flat-3" / "surfels.ply");

  int reported = 0;
  options.on_result = [&](const std::vector<panoptic::SceneFigures>& results) {
    EXPECT_EQ(results.size(), 2U);  // The one of before the kill is there.
    ++reported;
  };
  const std::vector<panoptic::SceneFigures> resumed = panoptic::run_panoptic_scenes(options);
  EXPECT_LE(reported, 1);
  EXPECT_EQ(fs::last_write_time(first), kept);
  EXPECT_EQ(fs::last_write_time(options.work / "flat-3" / "surfels.ply"), surfels);

  const std::vector<panoptic::SceneFigures> whole =
      panoptic::run_panoptic_scenes(tiny_options(folder.path() / "whole"));
  EXPECT_EQ(table_text(resumed), table_text(whole));

  ASSERT_EQ(whole.size(), 2U);
  EXPECT_EQ(whole[0].head, "query");
  EXPECT_EQ(whole[1].head, "panoptic-lifting");
  for (const panoptic::SceneFigures& f : whole) {
    EXPECT_EQ(f.find("strict")->views, 8);  // Every fourth of 32.
    EXPECT_EQ(f.find("trajectory")->views, 24);
    EXPECT_GT(f.statistic("held_out_psnr_db"), 12.0);  // Before holes are filled: 8 dB.
    EXPECT_GT(f.statistic("held_out_sensor_depth_l1_m"), 0.0);
    EXPECT_GT(f.find("strict")->mean_iou(), 0.0);
    EXPECT_GT(f.mask_figure("pq"), 0.0);
    EXPECT_LT(f.mask_figure("pq"), 1.0);
  }
  // Heads share shape and colour.
  EXPECT_EQ(whole[0].statistic("held_out_psnr_db"), whole[1].statistic("held_out_psnr_db"));
  // States are removed when a stage is done.
  for (const auto& entry : fs::recursive_directory_iterator(folder.path() / "whole")) {
    EXPECT_NE(entry.path().extension(), ".state") << entry.path();
  }

  // Another configuration is another result, on the same surfels.
  panoptic::PanopticRunOptions changed = tiny_options(folder.path() / "killed");
  changed.heads = {"query"};
  changed.config.panoptic.loss.dice = 0.5;
  (void)panoptic::run_panoptic_scenes(changed);
  EXPECT_NE(fs::last_write_time(first), kept);
  EXPECT_EQ(fs::last_write_time(options.work / "flat-3" / "surfels.ply"), surfels);
}

TEST(PanopticRun, AFolderThatIsNoRecordingIsRefused) {
  const TemporaryFolder folder("panoptic_run_bad");
  fs::create_directories(folder.path() / "empty");
  panoptic::PanopticRunOptions options = tiny_options(folder.path() / "work");
  options.scenes = panoptic::panoptic_scenes((folder.path() / "empty").string(), "").scenes;
  EXPECT_THROW((void)panoptic::run_panoptic_scenes(options), core::InputError);
}

}  // namespace
}  // namespace segsim::experiments
