// Videos of a run's trials: what they show is what the run did.
#include <algorithm>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <CLI/CLI.hpp>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/commands/commands.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/films/demo_video.h"
#include "experiments/films/internal/pages.h"
#include "experiments/films/internal/title_card.h"
#include "experiments/records/replay_log.h"
#include "experiments/runs/run.h"
#include "experiments/video/video_file.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const std::string kSpec = TinySpec{.name = "filmed",
                                   .goals = "couch, chair",
                                   .episodes = 2,
                                   .time_limit_s = 5.0,
                                   .more = R"(title: Filmed
success: {profile: segsim-object, distance_m: 1.0, visible_pixels: 30}
localisation: odom
pictures: false
videos: all
)"}
                              .text();

std::vector<cv::Mat> frames_of(const fs::path& file) {
  cv::VideoCapture video(file.string());
  std::vector<cv::Mat> frames;
  for (cv::Mat frame; video.read(frame);) frames.push_back(frame.clone());
  return frames;
}

/// Mean difference of their values.
double difference(const cv::Mat& a, const cv::Mat& b) {
  return cv::norm(a, b, cv::NORM_L1) / (3.0 * static_cast<double>(a.total()));
}

/// Entries of a folder, hidden ones included.
std::ptrdiff_t entries_of(const fs::path& folder) {
  return std::distance(fs::directory_iterator(folder), fs::directory_iterator());
}

class VideoTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("video");
    TinyScene().write(folder_->path() / "tiny");
    runs::RunOptions options;
    options.folders = {folder_->path(), folder_->path() / "work"};
    (void)runs::run_experiment(specs::parse_spec(kSpec, "filmed.yaml", options.folders),
                               options);
    stored_ = new results::StoredRun(results::load_run(folder_->path() / "work"));
  }
  static void TearDownTestSuite() {
    delete stored_;
    delete folder_;
  }
  static films::VideoOptions to(const std::string& name, double speed = 2.0) {
    return {folder_->path() / "out" / name, folder_->path(), speed};
  }
  static std::string segsim(const std::string& arguments) {
    CLI::App app;
    commands::add_video_command(app);
    return tests::input_error_of([&] { app.parse("video " + arguments); });
  }

  static TemporaryFolder* folder_;
  static results::StoredRun* stored_;
};
TemporaryFolder* VideoTest::folder_ = nullptr;
results::StoredRun* VideoTest::stored_ = nullptr;

TEST_F(VideoTest, ATrialPlayedAgainShowsWhatTheRunRecorded) {
  const records::TrialRow& trial = stored_->trials.at(0);
  const films::VideoSummary summary =
      films::write_trial_video(*stored_, trial, to("again.mp4"));
  EXPECT_FALSE(summary.copied);
  // Every tick, the outcome, and two seconds of it at 8 frames per second.
  EXPECT_EQ(summary.frames, trial.ticks + 1 + 16);
  EXPECT_DOUBLE_EQ(summary.duration_s, summary.frames / 8.0);
  const std::vector<cv::Mat> again = frames_of(to("again.mp4").output);
  const std::vector<cv::Mat> recorded = frames_of(stored_->folder / trial.video);
  ASSERT_EQ(again.size(), recorded.size());
  ASSERT_EQ(again.size(), static_cast<std::size_t>(summary.frames));
  double worst = 0.0, moved = 0.0;
  for (std::size_t k = 0; k < again.size(); ++k) {
    ASSERT_EQ(again[k].size(), recorded[k].size());
    worst = std::max(worst, difference(again[k], recorded[k]));
    moved = std::max(moved, difference(again[k], again[0]));
  }
  EXPECT_LT(worst, 0.5);
  EXPECT_GT(moved, 5.0) << "a still would pass the comparison as well";
}

TEST_F(VideoTest, BrowsersCanPlayIt) {
  const cv::VideoWriter probe((folder_->path() / "probe.mp4").string(),
                              cv::VideoWriter::fourcc('a', 'v', 'c', '1'), 10.0, {64, 64});
  if (!probe.isOpened()) GTEST_SKIP() << "no H.264 encoder here";
  (void)films::write_trial_video(*stored_, stored_->trials.at(0), to("codec.mp4"));
  const cv::VideoCapture video(to("codec.mp4").output.string());
  const int code = static_cast<int>(video.get(cv::CAP_PROP_FOURCC));
  const std::string name{static_cast<char>(code & 255), static_cast<char>((code >> 8) & 255),
                         static_cast<char>((code >> 16) & 255),
                         static_cast<char>((code >> 24) & 255)};
  EXPECT_THAT(name, testing::AnyOf("avc1", "h264", "H264"));
}

TEST_F(VideoTest, SpeedShortensIt) {
  const records::TrialRow& trial = stored_->trials.at(0);
  const films::VideoSummary fast =
      films::write_trial_video(*stored_, trial, to("fast.mp4", 20.0));
  EXPECT_NEAR(fast.duration_s, trial.sim_s / 20.0 + 2.0, 0.3);
}

TEST_F(VideoTest, APairLastsAsLongAsItsLongerTrial) {
  const records::TrialRow &left = stored_->trials.at(0), &right = stored_->trials.at(1);
  ASSERT_EQ(left.episode, right.episode);
  const films::VideoSummary summary =
      films::write_pair_video(*stored_, left, right, to("pair.mp4"));
  EXPECT_EQ(summary.frames, std::max(left.ticks, right.ticks) + 1 + 16);
  const std::vector<cv::Mat> frames = frames_of(to("pair.mp4").output);
  ASSERT_EQ(frames.size(), static_cast<std::size_t>(summary.frames));
  EXPECT_EQ(frames[0].size(), cv::Size(1280, 720));
  // Equal arms: below the captions, which name them, both sides look the same.
  const cv::Mat& middle = frames[frames.size() / 2];
  const cv::Rect views(0, 100, video::internal::kColumnWidth_px, 560);
  const cv::Mat other = middle(views + cv::Point(1280 - video::internal::kColumnWidth_px, 0));
  EXPECT_LT(difference(middle(views), other), 3.0);
}

TEST_F(VideoTest, WithoutALogTheRecordingIsCopiedOrNothingIsMade) {
  results::StoredRun moved = *stored_;
  records::TrialRow& trial = moved.trials.at(0);
  trial.log.clear();
  EXPECT_TRUE(films::write_trial_video(moved, trial, to("copy.mp4")).copied);
  EXPECT_EQ(core::read_file(to("copy.mp4").output),
            core::read_file(moved.folder / trial.video));
  trial.video.clear();
  EXPECT_THAT(tests::input_error_of(
                  [&] { (void)films::write_trial_video(moved, trial, to("none.mp4")); }),
              HasSubstr("a log to play again"));
  EXPECT_FALSE(fs::exists(to("none.mp4").output));
}

TEST_F(VideoTest, ATrialThatDoesNotHappenAgainIsNotShown) {
  const records::TrialRow& trial = stored_->trials.at(2);
  const fs::path log = records::replay_log_of(stored_->folder, trial);
  const std::string text = core::read_file(log);
  records::ReplayLog changed = records::read_replay_log(log);
  changed.ticks.at(5).pose.x_m += 1e-9;
  records::write_replay_log(log, changed);
  EXPECT_THAT(tests::input_error_of(
                  [&] { (void)films::write_trial_video(*stored_, trial, to("other.mp4")); }),
              HasSubstr("another from tick 5 on (pose)"));
  std::ofstream(log) << text;
  EXPECT_FALSE(fs::exists(to("other.mp4").output));
  for (const auto& entry : fs::directory_iterator(folder_->path() / "out")) {
    EXPECT_EQ(entry.path().string().find(".part"), std::string::npos) << entry.path();
  }
}

TEST_F(VideoTest, TheDemoHasItsPartsAndTheirLengths) {
  const films::DemoOptions options{to("demo.mp4"), "", ""};
  const films::VideoSummary summary = films::write_demo_video(*stored_, options);
  const std::vector<cv::Mat> frames = frames_of(options.video.output);
  ASSERT_EQ(frames.size(), static_cast<std::size_t>(summary.frames));
  EXPECT_EQ(frames[0].size(), cv::Size(1280, 720));
  // Title 6 s, reading 8 s, one pair with its title (3.5 s) and outcome (2 s), results 12 s.
  const std::vector<films::DemoPair> pairs =
      films::choose_demo_pairs(stored_->trials, "before", "after");
  ASSERT_EQ(pairs.size(), 1U);
  const double pair_s = std::max(pairs[0].before->sim_s, pairs[0].after->sim_s) / 2.0;
  EXPECT_NEAR(summary.duration_s, 6.0 + 8.0 + 3.5 + pair_s + 2.0 + 12.0, 0.4);
  // The last screen is the table's, but for what encoding costs its letters.
  const double loss =
      difference(frames.back(), films::internal::result_card(results::summarise(*stored_)));
  EXPECT_LT(loss, 6.0);
  EXPECT_LT(loss, 0.5 * difference(frames.back(), frames.front()));
}

TEST_F(VideoTest, BadRequestsAreOneLine) {
  const std::string work = (folder_->path() / "work").string();
  EXPECT_THAT(segsim(work), HasSubstr("--trial or --demo"));
  EXPECT_THAT(segsim(work + " --trial 77"), HasSubstr("expected the number of one of"));
  EXPECT_THAT(segsim(work + " --trial 1 --pair before nobody"),
              HasSubstr("an arm that ran tiny/"));
  EXPECT_THAT(segsim(work + "/nothing --demo"), HasSubstr("a results database"));
  EXPECT_THAT(
      segsim(work + " --trial 1 --data " + folder_->path().string() + " -o /proc/video.mp4"),
      HasSubstr("/proc/video.mp4"));
}

records::TrialRow row(const std::string& scene, const std::string& episode,
                      const std::string& arm, bool success, double sim_s) {
  records::TrialRow trial;
  trial.scene = scene;
  trial.episode = scene + "/" + episode;
  trial.arm = arm;
  trial.success = success;
  trial.outcome = success ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
  trial.sim_s = sim_s;
  trial.ticks = static_cast<int>(4.0 * sim_s);
  return trial;
}

TEST(DemoPairs, AreOfMedianLengthAndOneSpeaksAgainst) {
  std::vector<records::TrialRow> trials;
  const auto add = [&](const std::string& scene, const std::string& episode, bool before,
                       double before_s, bool after, double after_s) {
    trials.push_back(row(scene, episode, "before", before, before_s));
    trials.push_back(row(scene, episode, "after", after, after_s));
    trials.push_back(row(scene, episode, "oracle", true, 1.0));
  };
  add("a", "0", false, 90.0, true, 10.0);
  add("a", "1", false, 20.0, true, 30.0);  // Median of only after: 20, 30, 50, 90.
  add("a", "2", false, 5.0, true, 20.0);
  add("b", "0", false, 50.0, true, 10.0);  // The only one of another scene than a/0.
  add("b", "1", true, 10.0, false, 12.0);
  add("b", "2", false, 10.0, false, 12.0);
  const std::vector<films::DemoPair> pairs =
      films::choose_demo_pairs(trials, "before", "after");
  ASSERT_EQ(pairs.size(), 3U);
  // Sorted 20 (a/2), 30 (a/1), 50 (b/0), 90 (a/0): the upper median is b/0.
  EXPECT_EQ(pairs[0].before->episode, "b/0");
  EXPECT_EQ(pairs[0].after->arm, "after");
  EXPECT_THAT(pairs[0].reason, HasSubstr("One of 4 episodes in which only \"after\""));
  EXPECT_EQ(pairs[1].before->episode, "a/1");
  EXPECT_THAT(pairs[1].reason, HasSubstr("One of 3"));
  EXPECT_EQ(pairs[2].before->episode, "b/1");
  EXPECT_THAT(pairs[2].reason, HasSubstr("The only episode in which only \"before\""));
  trials.erase(trials.begin() + 12, trials.begin() + 15);  // Without b/1.
  EXPECT_EQ(films::choose_demo_pairs(trials, "before", "after").at(2).before->episode, "b/2");
  EXPECT_TRUE(films::choose_demo_pairs(trials, "before", "nobody").empty());
  for (records::TrialRow& trial : trials) trial.outcome = records::TrialOutcome::kError;
  EXPECT_TRUE(films::choose_demo_pairs(trials, "before", "after").empty());
}

TEST(ResultCard, BarsAreAsLongAsTheRates) {
  std::vector<records::TrialRow> trials;
  for (int k = 0; k < 20; ++k) {
    trials.push_back(row("a", std::to_string(k), "before", k < 4, 10.0));
    trials.push_back(row("a", std::to_string(k), "after", k < 15, 10.0));
  }
  records::SceneRow scene;
  scene.name = "a";
  std::vector<records::ArmRow> arms(2);
  arms[0].name = "before";
  arms[1].name = "after";
  const results::ResultTable table =
      results::summarise(records::RunRow{}, {scene}, arms, trials);
  const cv::Mat card = films::internal::result_card(table);
  EXPECT_EQ(card.size(), cv::Size(1280, 720));
  // Orange is "after": 15 of 20 of 500 pixels.
  cv::Mat orange;
  cv::inRange(card, cv::Scalar(20, 110, 230), cv::Scalar(40, 130, 250), orange);
  int columns = 0;
  for (int x = 0; x < orange.cols; ++x) columns += cv::countNonZero(orange.col(x)) > 0 ? 1 : 0;
  EXPECT_NEAR(columns, 375, 3);
}

TEST(VideoFile, IsThereWholeOrNotAtAll) {
  const TemporaryFolder folder("video_file");
  const fs::path file = folder.path() / "a.mp4";
  const cv::Mat page(51, 77, CV_8UC3, cv::Scalar(40, 90, 200));  // Odd sides.
  {
    video::internal::VideoFile abandoned(file, 10.0);
    abandoned.write(page);
  }
  EXPECT_EQ(entries_of(folder.path()), 0);
  // A kind of file that takes no H.264, and one of single pictures.
  for (const char* name : {"a.webm", "a.png"}) {
    video::internal::VideoFile other(folder.path() / name, 10.0);
    EXPECT_THROW(other.write(page), core::InputError) << name;
  }
  EXPECT_EQ(entries_of(folder.path()), 0);
  video::internal::VideoFile video(file, 10.0);
  video.write(page);
  video.hold(1.5);
  EXPECT_FALSE(fs::exists(file));
  video.finish();
  EXPECT_EQ(video.frames(), 16);
  EXPECT_EQ(entries_of(folder.path()), 1);
  const std::vector<cv::Mat> frames = frames_of(file);
  ASSERT_EQ(frames.size(), 16U);
  EXPECT_EQ(frames[0].size(), cv::Size(78, 52));
  EXPECT_LT(difference(frames[7](cv::Rect(0, 0, 77, 51)), page), 4.0);
}

TEST(TitleCard, LinesFit) {
  const std::string text =
      "Does this perception change make the robot reach its goal more often, in time?";
  const std::vector<std::string> lines = films::internal::wrapped(text, 20.0, 300.0);
  ASSERT_GT(lines.size(), 2U);
  std::string joined;
  for (const std::string& line : lines) {
    EXPECT_LE(drawing::text_width_px(line, 20.0), 300.0) << line;
    joined += (joined.empty() ? "" : " ") + line;
  }
  EXPECT_EQ(joined, text);
  EXPECT_EQ(films::internal::wrapped("unbreakable", 20.0, 5.0).size(), 1U);
}

}  // namespace
}  // namespace segsim::experiments
