// Trials in virtual time through the whole chain: run, record, replay, sweep.
#include <algorithm>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/commands/commands.h"
#include "experiments/records/replay_log.h"
#include "experiments/records/store.h"
#include "experiments/runs/run.h"
#include "experiments/specs/budget_file.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const char* const kBudget = R"(schema: segsim.budget/1
id: test-edge
resources: {gpu: 1, cpu: 1}
stages:
  capture: {ms: 20}
  detect:  {on: gpu, dist: {lognormal: {p50: 60, p95: 160}}, deadline_ms: 100}
  segment: {on: gpu, after: detect, per_item_ms: 15}
  policy:  {on: cpu, ms: 5}
  actuate: {ms: 8}
end_to_end: {deadline_ms: 2000}
)";

const std::string kSpec =
    TinySpec{
        .name = "late",
        .goals = "couch, chair",
        .episodes = 4,
        .arms = R"(  - {name: quick, detector: oracle}
  - {name: slow, detector: oracle, add_ms: {detect: 300}}
)",
        .time_limit_s = 40.0,
        .more =
            R"(clock: {mode: virtual, budget: "${data}/edge.yaml", camera: {period_ms: 150, jitter_ms: 20}}
success: {profile: segsim-object, distance_m: 1.0, visible_pixels: 30}
pictures: false
replays: {of: all, images: true}
)"}
        .text();

class ReplayTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("replay");
    TinyScene().write(folder_->path() / "tiny");
    std::ofstream(folder_->path() / "edge.yaml") << kBudget;
    (void)run("work", 2);
  }
  static void TearDownTestSuite() { delete folder_; }

  static runs::RunReport run(const std::string& work, int workers,
                             const std::string& text = kSpec) {
    runs::RunOptions options;
    options.folders = {folder_->path(), folder_->path() / work};
    options.workers = workers;
    return runs::run_experiment(specs::parse_spec(text, "late.yaml", options.folders),
                                options);
  }
  static fs::path log(const std::string& arm, const std::string& work = "work") {
    return folder_->path() / work / "replays" / "tiny" / ("couch-00." + arm + ".jsonl");
  }
  /// `segsim <arguments>`; what it complains about.
  static std::string segsim(const std::string& arguments) {
    CLI::App app;
    commands::add_replay_command(app);
    commands::add_budget_command(app);
    try {
      app.parse(arguments + " ");
      return "";
    } catch (const core::CheckFailed& error) {
      return std::string("check failed: ") + error.what();
    } catch (const core::InputError& error) {
      return std::string("input: ") + error.what();
    }
  }
  static std::string replay(const fs::path& path, const std::string& flags = "--verify") {
    return segsim("replay " + path.string() + " " + flags + " --data " +
                  folder_->path().string());
  }
  /// A copy of the log (with its images) in which a text is replaced.
  static fs::path tampered(const std::string& work, const std::string& from,
                           const std::string& to) {
    const fs::path copy = log("quick", work);
    fs::create_directories(copy.parent_path());
    std::string text = core::read_file(log("quick"));
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    std::ofstream(copy) << text;
    fs::copy(records::replay_images(log("quick")), records::replay_images(copy));
    return copy;
  }

  static TemporaryFolder* folder_;
};
TemporaryFolder* ReplayTest::folder_ = nullptr;

TEST_F(ReplayTest, TheChainDoesNotDependOnTheWorkers) {
  std::string without_images = kSpec;
  without_images.replace(without_images.find("images: true"), 12, "images: false");
  const auto hashes = [](const std::string& work) {
    const records::Store store(folder_->path() / work / "results.sqlite");
    std::vector<std::uint64_t> found;
    for (const records::TrialRow& row : store.trials(store.runs().back().run_id)) {
      EXPECT_EQ(row.error, "");
      found.push_back(row.state_hash);
    }
    return found;
  };
  (void)run("one", 1, without_images);
  (void)run("eight", 8, without_images);
  const auto one = hashes("one");
  ASSERT_EQ(one.size(), 8U);
  EXPECT_EQ(hashes("eight"), one);
  EXPECT_EQ(hashes("work"), one) << "keeping images changes nothing";
  EXPECT_NE(one[0], one[1]) << "the arms differ";
  const records::ReplayLog a = records::read_replay_log(log("slow", "one")),
                           b = records::read_replay_log(log("slow", "eight"));
  EXPECT_EQ(records::first_divergence(a.ticks, b.ticks).tick, -1);
}

TEST_F(ReplayTest, LateArmsActOnOlderImages) {
  const records::ReplayLog quick = records::read_replay_log(log("quick")),
                           slow = records::read_replay_log(log("slow"));
  const double rise_ms =
      sim::ms_from_ns(slow.timing.age.percentile(0.5) - quick.timing.age.percentile(0.5));
  EXPECT_GE(rise_ms, 50.0);
  EXPECT_LE(rise_ms, 550.0);
  // The same episode draws the same durations in both arms.
  const auto& a = quick.trace.stages().at("detect");
  EXPECT_EQ(slow.trace.at("detect", 0), a.front().second + 300'000'000);
}

TEST_F(ReplayTest, AllTrialsReplayEqual) {
  EXPECT_EQ(replay(folder_->path() / "work" / "replays"), "");
}

TEST_F(ReplayTest, AHundredTrialsReplayEqual) {
  std::string text = kSpec;
  const auto replace = [&text](const std::string& from, const std::string& to) {
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
  };
  // Short ones with few pixels: what counts is that so many different ones are equal.
  replace("episodes: 4", "episodes: 25");
  replace("time_limit_s: 40", "time_limit_s: 5\nrepetitions: 2");
  replace("width: 96, height: 72", "width: 40, height: 30");
  replace("visible_pixels: 30", "visible_pixels: 10");
  replace("images: true", "images: false");
  ASSERT_EQ(run("hundred", 2, text).trials_run, 100);
  testing::internal::CaptureStdout();
  EXPECT_EQ(replay(folder_->path() / "hundred" / "replays"), "");
  const std::string out = testing::internal::GetCapturedStdout();
  std::size_t equal = 0;
  for (std::size_t at = out.find(": equal"); at != std::string::npos;
       at = out.find(": equal", at + 1)) {
    ++equal;
  }
  EXPECT_EQ(equal, 100U);
}

TEST_F(ReplayTest, PerceptionFromTheLogNeedsNeitherRendererNorWeights) {
  EXPECT_EQ(replay(folder_->path() / "work" / "replays", "--verify --from-log"), "");
}

TEST_F(ReplayTest, OneBitOfAScoreIsNoticedAtTheTickThatUsesIt) {
  // The first image with a detection: its score is 1, the float before it 0.99999994.
  const records::ReplayLog recorded = records::read_replay_log(log("quick"));
  std::uint64_t image = 0;
  while (recorded.detections.at(image).empty()) {
    do ++image;
    while (!recorded.detections.contains(image));
  }
  const std::string line = "{\"image\":" + std::to_string(image) + ",\"detections\":[[";
  const core::Detection& d = recorded.detections.at(image)[0];
  ASSERT_EQ(d.score, 1.0F);
  const std::string from = line + std::to_string(d.class_index) + ",1.0,";
  const std::string to = line + std::to_string(d.class_index) + ",0.9999999403953552,";
  int expected = -1;
  for (std::size_t k = 0; k < recorded.ticks.size() && expected < 0; ++k) {
    if (recorded.ticks[k].capture_index == static_cast<std::int64_t>(image)) {
      expected = static_cast<int>(k);
    }
  }
  ASSERT_GE(expected, 0);
  const fs::path copy = tampered("bit", from, to);
  testing::internal::CaptureStdout();
  const std::string message =
      segsim("replay " + copy.string() + " --verify --from-log --data " +
             folder_->path().string() + " --work " + (folder_->path() / "work").string());
  const std::string out = testing::internal::GetCapturedStdout();
  EXPECT_THAT(message, HasSubstr("check failed: 1 of 1"));
  EXPECT_THAT(out, HasSubstr("differs from tick " + std::to_string(expected) +
                             " on: detections recorded"));
}

TEST_F(ReplayTest, AChangedPoseIsNamed) {
  const records::ReplayLog recorded = records::read_replay_log(log("quick"));
  records::ReplayLog changed = recorded;
  changed.ticks[5].pose.x_m += 1e-15 + std::abs(changed.ticks[5].pose.x_m) * 1e-15;
  const records::Divergence found = records::first_divergence(recorded.ticks, changed.ticks);
  EXPECT_EQ(found.tick, 5);
  EXPECT_EQ(found.field, "pose");
  changed.ticks.resize(3);
  EXPECT_EQ(records::first_divergence(recorded.ticks, changed.ticks).field, "ticks");
}

TEST_F(ReplayTest, DamagedLogsAreRefusedWithTheirLine) {
  EXPECT_THAT(replay(tampered("json", "{\"tick\":3,", "{\"tick\":3;")), HasSubstr("jsonl:"));
  EXPECT_THAT(replay(tampered("order", "{\"tick\":3,", "{\"tick\":4,")),
              HasSubstr("out of order"));
  EXPECT_THAT(replay(tampered("outcome", "\"outcome\":\"", "\"outcome\":\"un")),
              HasSubstr("expected an outcome (success, "));
  EXPECT_THAT(replay(tampered("mode", "\"mode\":", "\"mode\":9")), HasSubstr("mode 9"));
  EXPECT_THAT(replay(tampered("schema", "segsim.replay/1", "segsim.replay/7")),
              HasSubstr("jsonl:1"));
  const fs::path cut = tampered("cut", "{\"tick\":0,", "{\"tick\":0,");
  fs::resize_file(cut, fs::file_size(cut) / 2);
  EXPECT_THAT(replay(cut), HasSubstr("input:"));
  EXPECT_THAT(replay(folder_->path() / "nothing"), HasSubstr("none"));
}

TEST_F(ReplayTest, BudgetCheckJudgesARun) {
  const std::string budget = (folder_->path() / "edge.yaml").string();
  const std::string work = (folder_->path() / "work").string();
  testing::internal::CaptureStdout();
  const std::string strict = segsim("budget check " + budget + " --run " + work);
  const std::string out = testing::internal::GetCapturedStdout();
  EXPECT_THAT(strict, HasSubstr("deadlines do not hold"));
  EXPECT_THAT(out, HasSubstr("8 trials of"));
  EXPECT_EQ(segsim("budget check " + budget + " --run " + work + " --max-miss-rate 1"), "");
  // On its own: the same deadlines, no scene.
  EXPECT_THAT(segsim("budget check " + budget + " --seconds 120"),
              HasSubstr("deadlines do not hold"));
  EXPECT_THAT(segsim("budget check " + budget + " --run " + budget), HasSubstr("replay logs"));
}

TEST_F(ReplayTest, BudgetCheckSaysWhatItCannotJudge) {
  const std::string work = (folder_->path() / "work").string();
  // A stage that no trial played has a deadline.
  std::ofstream(folder_->path() / "more.yaml")
      << "schema: segsim.budget/1\nid: more\nresources: {gpu: 1}\nstages:\n"
         "  detect: {on: gpu, ms: 1, deadline_ms: 60000}\n"
         "  track: {on: gpu, after: detect, ms: 1, deadline_ms: 10}\n";
  testing::internal::CaptureStdout();
  const std::string verdict =
      segsim("budget check " + (folder_->path() / "more.yaml").string() + " --run " + work +
             " --max-miss-rate 1");
  EXPECT_THAT(testing::internal::GetCapturedStdout(),
              HasSubstr("track within 10.0 ms: never ran"));
  EXPECT_THAT(verdict, HasSubstr("1 of 2 deadlines do not hold"));
  // In lockstep nothing takes time.
  std::string text = kSpec;
  text.replace(text.find("clock:"), text.find("arms:") - text.find("clock:"), "");
  text.replace(text.find(", add_ms: {detect: 300}"), 23, "");
  (void)run("lockstep", 1, text);
  EXPECT_THAT(segsim("budget check " + (folder_->path() / "edge.yaml").string() + " --run " +
                     (folder_->path() / "lockstep").string()),
              testing::AllOf(HasSubstr("input:"), HasSubstr("lockstep")));
}

TEST_F(ReplayTest, ARunOfMissesEndsWithItsTrial) {
  // Every end-to-end deadline of 1 ms is missed, so the longest run is that of one trial.
  std::ofstream(folder_->path() / "none.yaml")
      << "schema: segsim.budget/1\nid: none\nresources: {gpu: 1}\nstages:\n"
         "  detect: {on: gpu, ms: 1}\nend_to_end: {deadline_ms: 1}\n";
  int longest = 0;
  for (const auto& entry :
       fs::recursive_directory_iterator(folder_->path() / "work/replays")) {
    if (entry.path().extension() != ".jsonl") continue;
    const records::ReplayLog one = records::read_replay_log(entry.path());
    longest = std::max(longest, one.timing.end_to_end.response.count());
  }
  const std::string json = (folder_->path() / "none.json").string();
  testing::internal::CaptureStdout();
  (void)segsim("budget check " + (folder_->path() / "none.yaml").string() + " --run " +
               (folder_->path() / "work").string() + " --json " + json);
  (void)testing::internal::GetCapturedStdout();
  const std::string text = core::read_file(json);
  EXPECT_THAT(text, HasSubstr("\"longest_miss_run\": " + std::to_string(longest)));
}

TEST_F(ReplayTest, DetectionsInUseForSeveralTicksAreCountedOnce) {
  // Images every 150 ms, ticks every 250 ms, 300 ms more per image: most ticks bring no news.
  const records::Store store(folder_->path() / "work" / "results.sqlite");
  bool some_without_news = false;
  for (const records::TrialRow& row : store.trials(1)) {
    const std::string episode = row.episode.substr(row.episode.find('/') + 1);
    std::string stem = episode;
    std::replace(stem.begin(), stem.end(), '/', '-');
    const records::ReplayLog one = records::read_replay_log(
        folder_->path() / "work/replays/tiny" / (stem + "." + row.arm + ".jsonl"));
    const auto fresh = std::count_if(one.ticks.begin(), one.ticks.end(),
                                     [](const sim::TickRecord& tick) { return tick.fresh; });
    EXPECT_EQ(row.why.images, fresh);
    some_without_news |= row.why.images < row.ticks;
    int detections = 0;
    for (const sim::TickRecord& tick : one.ticks) {
      detections += tick.fresh ? tick.detections_of_goal : 0;
    }
    EXPECT_EQ(row.why.true_detections + row.why.false_detections, detections);
    // An oracle with boxes of the very image errs in nothing, however late it is.
    EXPECT_EQ(row.why.false_detections, 0);
  }
  EXPECT_TRUE(some_without_news);
}

TEST_F(ReplayTest, ATraceOfALogIsABudgetsTrace) {
  const fs::path file = folder_->path() / "trace.csv";
  testing::internal::CaptureStdout();
  const std::string message =
      segsim("budget trace " + log("quick").string() + " -o " + file.string());
  (void)testing::internal::GetCapturedStdout();
  ASSERT_EQ(message, "");
  EXPECT_EQ(specs::read_trace_csv(file), records::read_replay_log(log("quick")).trace);
}

TEST_F(ReplayTest, ASweepGivesATableAndAPicture) {
  const fs::path spec = folder_->path() / "sweep.yaml";
  std::ofstream(spec) << kSpec;
  const fs::path output = folder_->path() / "sweep";
  testing::internal::CaptureStdout();
  const std::string message =
      segsim("budget sweep " + spec.string() + " --add-ms 0,600 --arm quick --data " +
             folder_->path().string() + " --work " + (folder_->path() / "swept").string() +
             " -o " + output.string());
  const std::string out = testing::internal::GetCapturedStdout();
  EXPECT_EQ(message, "");
  EXPECT_THAT(out, HasSubstr("Latency margin of detect"));
  EXPECT_TRUE(fs::exists(output / "sweep.png"));
  const records::Store store(output / "results.sqlite");
  EXPECT_EQ(store.trials(store.runs().back().run_id).size(), 8U);
  EXPECT_THAT(core::read_file(output / "sweep.csv"), HasSubstr("\n600,"));
  EXPECT_THAT(segsim("budget sweep " + spec.string() +
                     " --add-ms 0,600 --stage detekt --data " + folder_->path().string()),
              HasSubstr("--stage"));
}

}  // namespace
}  // namespace segsim::experiments
