#include "experiments/run.h"

#include <fstream>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/store.h"
#include "renderer/exr_io.h"
#include "renderer/frame_writer.h"
#include "tiny_scene.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// Two oracle arms, so that no weights are needed; the second hears less.
const char* const kSpec = R"(schema: segsim.experiment/1
name: tiny
seed: 3
scenes:
  - name: tiny
    title: Two rooms
    bundle: ${data}/tiny
    goals: [couch, chair]
    episodes: 4
    camera_height_m: 1.0
arms:
  - {name: before, detector: oracle}
  - {name: after, detector: oracle}
robot: jackal-gentle
control_period_s: 0.25
time_limit_s: 60
camera: {width: 96, height: 72, hfov_deg: 70, pitch_down_deg: 10, depth_range_m: 6}
success: {profile: segsim-object, distance_m: 1.0, visible_pixels: 30}
pictures: false
)";

class RunTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("run");
    TinyScene().write(folder_->path() / "tiny");
  }
  static void TearDownTestSuite() { delete folder_; }

  static RunReport run(const std::string& work, int workers, int max_trials = 0,
                       const std::string& text = kSpec, bool new_run = false) {
    RunOptions options;
    options.folders = {folder_->path(), folder_->path() / work};
    options.workers = workers;
    options.max_trials = max_trials;
    options.new_run = new_run;
    const ExperimentSpec spec = parse_spec(text, "tiny.yaml", options.folders);
    return run_experiment(spec, options);
  }

  static std::vector<TrialRow> rows(const std::string& work) {
    const Store store(folder_->path() / work / "results.sqlite");
    return store.trials(store.runs().back().run_id);
  }

  static TemporaryFolder* folder_;
};
TemporaryFolder* RunTest::folder_ = nullptr;

/// Everything that must not depend on the machine's load.
std::string essence(const std::vector<TrialRow>& rows) {
  std::string text;
  for (const TrialRow& row : rows) {
    text += row.episode + " " + row.arm + " " + row.outcome + " " + std::to_string(row.spl) +
            " " + std::to_string(row.path_m) + " " + std::to_string(row.ticks) + " " +
            std::to_string(row.contacts) + " " + std::to_string(row.state_hash) + row.error +
            "\n";
  }
  return text;
}

TEST_F(RunTest, WorkersAndInterruptionDoNotChangeTheRows) {
  const RunReport whole = run("whole", 1);
  EXPECT_EQ(whole.trials_run, 8);
  EXPECT_EQ(whole.trials_left, 0);
  const std::vector<TrialRow> expected = rows("whole");
  ASSERT_EQ(expected.size(), 8U);
  for (const TrialRow& row : expected) EXPECT_EQ(row.error, "");

  const RunReport first = run("parts", 3, 3);
  EXPECT_EQ(first.trials_run, 3);
  EXPECT_EQ(first.trials_left, 5);
  EXPECT_EQ(rows("parts").size(), 3U);
  EXPECT_THAT(first.table.notes, testing::Contains(HasSubstr("INTERIM")));
  const RunReport rest = run("parts", 3);
  EXPECT_EQ(rest.run_id, first.run_id);
  EXPECT_EQ(rest.trials_run, 5);
  EXPECT_EQ(essence(rows("parts")), essence(expected));

  // A third call finds nothing to do.
  EXPECT_EQ(run("parts", 2).trials_run, 0);

  // The same detector twice: no discordant pair (common random numbers).
  EXPECT_EQ(whole.table.scenes[0].pairs.discordant(), 0);
  EXPECT_EQ(whole.table.scenes[0].pairs.total(), 4);
  // With an oracle most of these easy searches succeed.
  EXPECT_GE(whole.table.scenes[0].arms[0].success.successes, 3) << essence(expected);

  for (const char* name : {"table.txt", "table.md", "table.csv", "table.json", "trials.csv",
                           "episodes/tiny.jsonl", "tracks/tiny/couch-00.before.geojson",
                           "tracks/tiny/couch-00.before.kml"}) {
    EXPECT_TRUE(fs::exists(folder_->path() / "whole" / name)) << name;
  }
}

TEST_F(RunTest, AChangedSpecIsRefusedUnlessANewRunIsAskedFor) {
  (void)run("changed", 2, 1);
  std::string text = kSpec;
  text.replace(text.find("seed: 3"), 7, "seed: 4");
  try {
    (void)run("changed", 2, 1, text);
    FAIL() << "expected an error";
  } catch (const core::InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("--new"));
  }
  EXPECT_EQ(run("changed", 2, 1, text, true).run_id, 2);
}

TEST_F(RunTest, AChangedEpisodeFileIsRefused) {
  (void)run("episodes", 2, 1);
  const fs::path file = folder_->path() / "episodes" / "episodes" / "tiny.jsonl";
  std::string text = core::read_file(file);
  const std::size_t at = text.find("\"shortest_path_m\":") + 18;
  text[at] = text[at] == '9' ? '8' : '9';
  std::ofstream(file) << text;
  EXPECT_THROW((void)run("episodes", 2, 1), core::InputError);
}

TEST_F(RunTest, TwoRunsInOneFolderAreRefused) {
  const fs::path work = folder_->path() / "locked";
  fs::create_directories(work);
  const int descriptor = open((work / ".lock").c_str(), O_CREAT | O_RDWR, 0644);
  ASSERT_EQ(flock(descriptor, LOCK_EX | LOCK_NB), 0);
  EXPECT_THROW((void)run("locked", 1, 1), core::InputError);
  close(descriptor);
}

/// What is written is the robot's view: pose and time of each tick, every channel, names.
TEST_F(RunTest, FramesAreRecordedAndChangeNothing) {
  (void)run("unseen", 1, 4);
  EXPECT_FALSE(fs::exists(folder_->path() / "unseen" / "frames"));
  const std::string text = std::string(kSpec) + "frames: {of: first, every_s: 1.0}\n";
  const fs::path frames = folder_->path() / "seen" / "frames" / "tiny";
  fs::create_directories(frames / "couch-00.before");
  std::ofstream(frames / "couch-00.before" / "frame-999999.exr") << "of an older trial";
  (void)run("seen", 2, 4, text);
  EXPECT_EQ(essence(rows("seen")), essence(rows("unseen")));

  // One control period is 0.25 s, so every fourth tick; of the first episode's arms only.
  EXPECT_EQ(std::distance(fs::directory_iterator(frames), fs::directory_iterator()), 2);
  for (const TrialRow& row : rows("seen")) {
    if (row.episode != "tiny/couch/00") continue;
    const fs::path folder = frames / ("couch-00." + row.arm);
    ASSERT_TRUE(fs::exists(folder)) << folder;
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()),
              (row.ticks + 3) / 4);
    for (int tick = 0; tick < row.ticks; tick += 4) {
      const fs::path file = folder / renderer::sequence_file_name(tick);
      const core::Frame frame = renderer::read_frame_exr(file);
      EXPECT_EQ(frame.intrinsics.width_px, 96);
      EXPECT_NEAR(frame.T_world_camera.translation_m().z, 1.0, 1e-6);
      EXPECT_FALSE(frame.rgb.empty() || frame.depth_m.empty() || frame.normal.empty() ||
                   frame.instance.empty());
      const renderer::FrameInfo info = renderer::read_frame_info_exr(file);
      EXPECT_EQ(info.time_ns, tick * std::int64_t{250'000'000});
      EXPECT_EQ(info.scene, "tiny");
      EXPECT_EQ(info.scene_sha256.size(), 64U);
      EXPECT_EQ(info.names->instances.name(1), "couch_1");
      EXPECT_EQ(info.names->classes.name(TinyScene::kWall), "wall");
    }
  }
}

TEST_F(RunTest, FramesThatCannotBeWrittenFailTheTrial) {
  const fs::path work = folder_->path() / "full";
  fs::create_directories(work);
  std::ofstream(work / "frames") << "a file in the way";
  (void)run("full", 1, 1, std::string(kSpec) + "frames: {of: all}\n");
  ASSERT_EQ(rows("full").size(), 1U);
  EXPECT_EQ(rows("full")[0].outcome, "error");
  EXPECT_THAT(rows("full")[0].error, HasSubstr("frames"));
}

TEST_F(RunTest, PicturesAndVideosAreMadeOnRequest) {
  std::string text = kSpec;
  text.replace(text.find("pictures: false"), 15, "pictures: true\nvideos: first");
  (void)run("shown", 2, 2, text);
  for (const TrialRow& row : rows("shown")) {
    EXPECT_TRUE(fs::exists(folder_->path() / "shown" / row.picture)) << row.picture;
    EXPECT_TRUE(fs::exists(folder_->path() / "shown" / row.video)) << row.video;
    EXPECT_TRUE(fs::exists(folder_->path() / "shown" / row.track)) << row.track;
  }
}

}  // namespace
}  // namespace segsim::experiments
