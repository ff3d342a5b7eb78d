#include "experiments/runs/run.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <set>
#include <string>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>

#include "core/error.h"
#include "core/file_io.h"
#include "core/process/kernel_choice.h"
#include "experiments/episodes/episodes.h"
#include "experiments/records/store.h"
#include "experiments/records/trial_log.h"
#include "experiments/trials/episode_validation.h"
#include "renderer/files/exr_io.h"
#include "renderer/files/frame_writer.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// Two oracle arms, so that no weights are needed; the second hears less.
const std::string kSpec =
    TinySpec{.goals = "couch, chair",
             .episodes = 4,
             .time_limit_s = 60.0,
             .more = R"(success: {profile: segsim-object, distance_m: 1.0, visible_pixels: 30}
pictures: false
)"}
        .text();

class RunTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("run");
    TinyScene().write(folder_->path() / "tiny");
  }
  static void TearDownTestSuite() { delete folder_; }

  static runs::RunReport run(const std::string& work, int workers, int max_trials = 0,
                             const std::string& text = kSpec, bool new_run = false) {
    runs::RunOptions options;
    options.folders = {folder_->path(), folder_->path() / work};
    options.workers = workers;
    options.max_trials = max_trials;
    options.new_run = new_run;
    const specs::ExperimentSpec spec = specs::parse_spec(text, "tiny.yaml", options.folders);
    return runs::run_experiment(spec, options);
  }

  static std::vector<records::TrialRow> rows(const std::string& work) {
    const records::Store store(folder_->path() / work / "results.sqlite");
    return store.trials(store.runs().back().run_id);
  }

  static TemporaryFolder* folder_;
};
TemporaryFolder* RunTest::folder_ = nullptr;

/// Everything that must not depend on the machine's load.
std::string essence(const std::vector<records::TrialRow>& rows) {
  std::string text;
  for (const records::TrialRow& row : rows) {
    text += row.episode + " " + row.arm + " " + to_string(row.outcome) + " " +
            std::to_string(row.spl) + " " + std::to_string(row.path_m) + " " +
            std::to_string(row.ticks) + " " + std::to_string(row.contacts) + " " +
            std::to_string(row.state_hash) + row.error + "\n";
  }
  return text;
}

TEST_F(RunTest, WorkersAndInterruptionDoNotChangeTheRows) {
  const runs::RunReport whole = run("whole", 1);
  EXPECT_EQ(whole.trials_run, 8);
  EXPECT_EQ(whole.trials_left, 0);
  const std::vector<records::TrialRow> expected = rows("whole");
  ASSERT_EQ(expected.size(), 8U);
  for (const records::TrialRow& row : expected) EXPECT_EQ(row.error, "");

  const runs::RunReport first = run("parts", 3, 3);
  EXPECT_EQ(first.trials_run, 3);
  EXPECT_EQ(first.trials_left, 5);
  EXPECT_EQ(rows("parts").size(), 3U);
  EXPECT_THAT(first.table.notes, testing::Contains(HasSubstr("INTERIM")));
  const runs::RunReport rest = run("parts", 3);
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

TEST_F(RunTest, OtherKernelsAreRefusedAndDigestsWritten) {
  core::set_environment(core::KernelChoice::kFast);
  const runs::RunReport began = run("kernels", 1, 1);
  EXPECT_TRUE(began.trials_left > 0);
  EXPECT_NE(began.digests.back().stage,
            reproducibility::DigestStage::kTrials);  // Some are missing.
  core::set_environment(core::KernelChoice::kReproducible);
  try {
    run("kernels", 1);
    ADD_FAILURE() << "continued with other kernels";
  } catch (const core::InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("fast kernels, with which it began"));
    EXPECT_THAT(error.what(), HasSubstr("found reproducible"));
  }
  core::set_environment(core::KernelChoice::kFast);
  const runs::RunReport ended = run("kernels", 2);
  EXPECT_EQ(ended.trials_left, 0);
  const reproducibility::DigestRecord record =
      reproducibility::read_digests(ended.results / "digests.json");
  ASSERT_EQ(record.stages.back().stage, reproducibility::DigestStage::kTrials);
  EXPECT_EQ(record.stages.back().sha256, ended.results_sha256);
  EXPECT_EQ(record.machine.kernels, core::KernelChoice::kFast);
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

/// A given set: what cannot be done is listed and in no rate; the others run.
TEST_F(RunTest, AnEpisodeFileIsRunAndWhatIsInfeasibleLeftOut) {
  (void)run("source", 1, 1);
  episodes::EpisodeSet set =
      episodes::read_episodes(folder_->path() / "source" / "episodes" / "tiny.jsonl");
  ASSERT_EQ(set.episodes.size(), 4U);
  set.episodes[1].start = {40.0, 0.0, 0.0};
  set.episodes[2].view_points_m = {{set.episodes[2].start.x_m, set.episodes[2].start.y_m}};
  set.episodes[2].view_point_instance.clear();
  set.episodes[2].view_point_iou.clear();
  set.oracle = episodes::OracleRecord{3, 4, 0.5, "segsim-object"};
  episodes::write_episodes(folder_->path() / "given.jsonl", set);

  std::string text = kSpec;
  const std::string rules = "goals: [couch, chair]\n    episodes: 4\n";
  text.replace(text.find(rules), rules.size(), "episode_file: ${data}/given.jsonl\n");
  const runs::RunReport report = run("given", 2, 0, text);
  EXPECT_EQ(report.trials_run, 8);
  std::map<std::string, int> outcomes;
  for (const records::TrialRow& row : rows("given")) {
    EXPECT_EQ(row.outcome == records::TrialOutcome::kInfeasible,
              row.episode == set.episodes[1].id);
    EXPECT_EQ(row.outcome == records::TrialOutcome::kTrivial,
              row.episode == set.episodes[2].id);
    ++outcomes[row.counts() ? "counts" : to_string(row.why.cause.value())];
  }
  EXPECT_EQ(outcomes,
            (std::map<std::string, int>{{"counts", 4}, {"infeasible", 2}, {"trivial", 2}}));
  const results::ArmSummary& arm = report.table.scenes[0].arms[0];
  EXPECT_EQ(arm.success.trials, 2);
  EXPECT_EQ(arm.excluded_trials, 2);
  EXPECT_THAT(report.table.notes, testing::Contains(HasSubstr("1 episode infeasible")));
  EXPECT_THAT(report.table.notes, testing::Contains(HasSubstr("FLAGGED episodes")));
  EXPECT_EQ(run("given", 2, 0, text).trials_run, 0);  // They are done.

  // Allowed, a trivial episode runs.
  text.replace(text.find("episode_file"), 12, "allow_trivial: true\n    episode_file");
  (void)run("trivial", 2, 0, text);
  for (const records::TrialRow& row : rows("trivial"))
    EXPECT_NE(row.outcome, records::TrialOutcome::kTrivial);
}

/// Validation draws nothing far from the goal; the oracle's trials are the same as in a run.
TEST_F(RunTest, ValidationIsARunOfTheOraclePath) {
  std::string text = kSpec;
  const std::string arms = "{name: before, detector: oracle}";
  text.replace(text.find(arms), arms.size(),
               "{name: path, detector: oracle, policy: oracle-path}");
  const std::string px = "visible_pixels: 30";
  text.replace(text.find(px), px.size(), "visible_pixels: 40");
  (void)run("path", 2, 0, text);
  const trials::Validation validation = trials::validate_episodes(
      folder_->path() / "path" / "episodes" / "tiny.jsonl", folder_->path() / "tiny", {});
  ASSERT_EQ(validation.trials.size(), 4U);
  int successes = 0;
  for (const records::TrialRow& row : rows("path")) {
    if (row.arm != "path") continue;
    successes += row.success ? 1 : 0;
    const auto same =
        std::find_if(validation.trials.begin(), validation.trials.end(),
                     [&](const records::TrialRow& t) { return t.episode == row.episode; });
    ASSERT_NE(same, validation.trials.end());
    // The way is the same to the last bit; images are drawn near the goal only, so the hash of
    // the whole state is another.
    EXPECT_EQ(same->path_m, row.path_m);
    EXPECT_EQ(same->sim_s, row.sim_s);
    EXPECT_EQ(same->outcome, row.outcome);
    EXPECT_EQ(same->spl, row.spl);
  }
  EXPECT_EQ(validation.oracle.successes, successes);
  EXPECT_GE(successes, 3);
  EXPECT_EQ(validation.oracle.episodes, 4);
  for (const episodes::EpisodeFinding& finding : validation.findings) {
    EXPECT_EQ(finding.state, episodes::EpisodeState::kFine);
  }
  trials::ValidationOptions unknown;
  unknown.profile = "habitat";
  EXPECT_THROW(
      (void)trials::validate_episodes(folder_->path() / "path" / "episodes" / "tiny.jsonl",
                                      folder_->path() / "tiny", unknown),
      core::InputError);
}

/// Every trial says why it failed, and has a log from which its story can be told.
TEST_F(RunTest, TrialsAreAttributedAndLogged) {
  std::string text = kSpec;
  text.replace(text.find("time_limit_s: 60"), 16, "time_limit_s: 3");
  const runs::RunReport report = run("short", 2, 0, text);
  for (const records::TrialRow& row : rows("short")) {
    EXPECT_EQ(row.outcome, records::TrialOutcome::kTimeout);
    EXPECT_TRUE(row.why.known());
    EXPECT_NE(row.why.cause, records::Cause::kDidNotFail);
    EXPECT_GE(row.why.inevitable_tick, 0);
    EXPECT_LT(row.why.inevitable_tick, row.ticks);
    const records::TrialLog log = records::read_trial_log(folder_->path() / "short" / row.log);
    EXPECT_EQ(static_cast<int>(log.track.size()), row.ticks);
    EXPECT_EQ(log.bundle, folder_->path() / "tiny");
    EXPECT_EQ(log.episode.id, row.episode);
  }
  const std::string table = results::format_table(report.table, support::TableFormat::kText);
  EXPECT_THAT(table, HasSubstr("Why trials failed"));
  EXPECT_THAT(table, HasSubstr("success: segsim-object"));
  EXPECT_THAT(table, HasSubstr("allenact-robothor"));
}

TEST_F(RunTest, AnotherProfileChangesTheVerdictNotTheTrial) {
  std::string text = kSpec;
  const std::string rule = "profile: segsim-object, distance_m: 1.0, visible_pixels: 30";
  (void)run("object", 2);
  text.replace(text.find(rule), rule.size(), "profile: semexp-gibson, visible_pixels: 30");
  (void)run("semexp", 2, 0, text);
  const std::vector<records::TrialRow> a = rows("object"), b = rows("semexp");
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t k = 0; k < a.size(); ++k) {
    EXPECT_EQ(a[k].state_hash, b[k].state_hash);
    EXPECT_EQ(b[k].success, b[k].why.stopped && b[k].why.object_m == 0.0);
    EXPECT_EQ(b[k].success, b[k].outcome == records::TrialOutcome::kSuccess);
    EXPECT_EQ(b[k].success, b[k].why.cause == records::Cause::kDidNotFail);
  }
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
  const std::string text = kSpec + "frames: {of: first, every_s: 1.0}\n";
  const fs::path frames = folder_->path() / "seen" / "frames" / "tiny";
  fs::create_directories(frames / "couch-00.before");
  std::ofstream(frames / "couch-00.before" / "frame-999999.exr") << "of an older trial";
  (void)run("seen", 2, 4, text);
  EXPECT_EQ(essence(rows("seen")), essence(rows("unseen")));

  // One control period is 0.25 s, so every fourth tick; of the first episode's arms only.
  EXPECT_EQ(std::distance(fs::directory_iterator(frames), fs::directory_iterator()), 2);
  for (const records::TrialRow& row : rows("seen")) {
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
  (void)run("full", 1, 1, kSpec + "frames: {of: all}\n");
  ASSERT_EQ(rows("full").size(), 1U);
  EXPECT_EQ(rows("full")[0].outcome, records::TrialOutcome::kError);
  EXPECT_THAT(rows("full")[0].error, HasSubstr("frames"));
}

TEST_F(RunTest, PicturesAndVideosAreMadeOnRequest) {
  std::string text = kSpec;
  text.replace(text.find("pictures: false"), 15, "pictures: true\nvideos: first");
  (void)run("shown", 2, 2, text);
  const auto is_file = [&](const std::string& name) {
    return fs::is_regular_file(folder_->path() / "shown" / name);
  };
  std::set<std::string> filmed;  // The first episode, by every arm.
  for (const records::TrialRow& row : rows("shown")) {
    EXPECT_TRUE(is_file(row.picture)) << row.picture;
    EXPECT_TRUE(is_file(row.track)) << row.track;
    if (row.video.empty()) continue;
    EXPECT_TRUE(is_file(row.video)) << row.video;
    filmed.insert(row.episode);
  }
  EXPECT_EQ(filmed.size(), 1U);
}

}  // namespace
}  // namespace segsim::experiments
