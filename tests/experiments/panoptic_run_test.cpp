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
#include "tiny_scene.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

PanopticRunOptions tiny_options(const fs::path& work) {
  PanopticRunOptions options;
  options.scenes = panoptic_scenes("flat-3", "").scenes;
  options.heads = {"query", "panoptic-lifting"};
  options.mask_level = 1.0;
  options.device.threads = 1;
  options.work = work;
  make_quick(options);
  options.config.panoptic.iterations = 40;
  return options;
}

std::string table_text(const std::vector<SceneFigures>& results) {
  PanopticTable table;
  table.results = results;
  table.rules = panoptic_rule_names();
  table.planned = static_cast<int>(results.size());
  return format_panoptic_table(table, TableFormat::kJson);
}

TEST(PanopticRun, KilledAndResumedGivesTheSameTable) {
  const TemporaryFolder folder("panoptic_run");
  PanopticRunOptions options = tiny_options(folder.path() / "killed");
  const fs::path first = options.work / "flat-3" / "query.json";
  // The child first: a fork must not happen beside threads.
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    (void)run_panoptic_scenes(options);
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
  options.on_result = [&](const std::vector<SceneFigures>& results) {
    EXPECT_EQ(results.size(), 2U);  // The one of before the kill is there.
    ++reported;
  };
  const std::vector<SceneFigures> resumed = run_panoptic_scenes(options);
  EXPECT_LE(reported, 1);
  EXPECT_EQ(fs::last_write_time(first), kept);
  EXPECT_EQ(fs::last_write_time(options.work / "flat-3" / "surfels.ply"), surfels);

  const std::vector<SceneFigures> whole =
      run_panoptic_scenes(tiny_options(folder.path() / "whole"));
  EXPECT_EQ(table_text(resumed), table_text(whole));

  ASSERT_EQ(whole.size(), 2U);
  EXPECT_EQ(whole[0].head, "query");
  EXPECT_EQ(whole[1].head, "panoptic-lifting");
  for (const SceneFigures& f : whole) {
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
  PanopticRunOptions changed = tiny_options(folder.path() / "killed");
  changed.heads = {"query"};
  changed.config.panoptic.loss.dice = 0.5;
  (void)run_panoptic_scenes(changed);
  EXPECT_NE(fs::last_write_time(first), kept);
  EXPECT_EQ(fs::last_write_time(options.work / "flat-3" / "surfels.ply"), surfels);
}

TEST(PanopticRun, AFolderThatIsNoRecordingIsRefused) {
  const TemporaryFolder folder("panoptic_run_bad");
  fs::create_directories(folder.path() / "empty");
  PanopticRunOptions options = tiny_options(folder.path() / "work");
  options.scenes = panoptic_scenes((folder.path() / "empty").string(), "").scenes;
  EXPECT_THROW((void)run_panoptic_scenes(options), core::InputError);
}

}  // namespace
}  // namespace segsim::experiments
