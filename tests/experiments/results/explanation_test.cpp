#include "experiments/results/explanation.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/support/gzip_file.h"
#include "renderer/cpu_renderer.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

using testing::Contains;
using testing::HasSubstr;

/// Twenty seconds: looks around, sees the couch at 6 s, is told of a wrong one at 8 s and of
/// the right one at 9 s, drives to the wrong one from 12 s on.
records::TrialLog a_log() {
  records::TrialLog log;
  log.scene_title = "Two rooms";
  log.arm = "before";
  log.bundle = "scenes/tiny";
  log.camera = core::CameraIntrinsics::from_fov(96, 72, 1.2);
  log.camera_height_m = 1.0;
  log.time_limit_s = 20.0;
  log.stop_reason = core::StopReason::kGoalReached;
  log.episode.id = "tiny/couch/00";
  log.episode.class_name = "couch";
  log.episode.start = {-1.0, 1.5, 0.0};
  log.episode.view_points_m = {{2.5, -1.0}, {3.0, -0.5}};
  log.episode.shortest_path_m = 4.5;
  log.shortest_path_m = {{-1.0, 1.5}, {2.5, -1.0}};
  for (int k = 0; k < 20; ++k) {
    sim::TickRecord tick;
    tick.time_ns = k * core::kNsPerSecond;
    tick.pose = {-1.0 + 0.1 * k, 1.5, -0.4};
    tick.mode = k < 4    ? core::PolicyMode::kInitialize
                : k < 12 ? core::PolicyMode::kExplore
                         : core::PolicyMode::kNavigate;
    tick.command = {0.1, 0.0};
    log.track.push_back(tick);
    log.evidence.emplace_back();
    log.distance_m.push_back(5.0 - 0.1 * k);
  }
  log.track.back().mode = core::PolicyMode::kStop;
  log.track[15].in_contact = true;
  log.distance_m[3] = std::numeric_limits<double>::infinity();
  log.evidence[6] = {200, 1, 0, 0};
  log.evidence[8] = {20, 1, 0, 1};
  log.evidence[9] = {250, 1, 1, 0};
  log.detections = {{8, {1.5F, 2, 30, 40}, 0.625F, false}, {9, {40, 20, 80, 60}, 0.75F, true}};
  log.objects = {{{0.5, 2.0}, 0, 0.5F}};
  log.target_m = glm::dvec2(0.5, 2.0);
  return log;
}

records::TrialRow a_row() {
  records::TrialRow row;
  row.trial_id = 17;
  row.arm = "before";
  row.scene = "tiny";
  row.episode = "tiny/couch/00";
  row.goal_class = "couch";
  row.outcome = records::TrialOutcome::kStoppedFar;
  row.stop_reason = core::StopReason::kGoalReached;
  row.shortest_path_m = 4.5;
  row.path_m = 2.0;
  row.distance_to_goal_m = 3.1;
  row.ticks = 20;
  row.sim_s = 19.0;
  row.first_visible_tick = 6;
  row.why.cause = records::Cause::kFalsePositive;
  row.why.inevitable_tick = 19;
  row.why.decisive_tick = 12;
  row.why.visible_frames = 2;
  row.why.detected_frames = 1;
  row.why.first_true_tick = 9;
  row.why.false_detections = 1;
  row.why.stopped = true;
  return row;
}

TEST(TrialLogFile, GivesBackWhatWasWritten) {
  const TemporaryFolder folder("log");
  const auto file = folder.path() / "t.json.gz";
  const records::TrialLog log = a_log();
  records::write_trial_log(file, log);
  const records::TrialLog again = records::read_trial_log(file);
  EXPECT_EQ(again.scene_title, log.scene_title);
  EXPECT_EQ(again.bundle, log.bundle);
  EXPECT_DOUBLE_EQ(again.camera.fx_px, log.camera.fx_px);
  EXPECT_EQ(again.episode.view_points_m, log.episode.view_points_m);
  ASSERT_EQ(again.track.size(), log.track.size());
  for (std::size_t k = 0; k < log.track.size(); ++k) {
    EXPECT_EQ(again.track[k].time_ns, log.track[k].time_ns);
    EXPECT_NEAR(again.track[k].pose.x_m, log.track[k].pose.x_m, 1e-4);
    EXPECT_EQ(again.track[k].mode, log.track[k].mode);
    EXPECT_EQ(again.track[k].in_contact, log.track[k].in_contact);
    EXPECT_EQ(again.evidence[k].largest_px, log.evidence[k].largest_px);
    EXPECT_EQ(std::isfinite(again.distance_m[k]), std::isfinite(log.distance_m[k]));
  }
  ASSERT_EQ(again.detections.size(), 2U);
  EXPECT_EQ(again.detections[1].tick, 9);
  EXPECT_TRUE(again.detections[1].is_goal);
  EXPECT_FLOAT_EQ(again.detections[0].box.x0, 1.5F);
  EXPECT_EQ(again.target_m, log.target_m);
  ASSERT_EQ(again.objects.size(), 1U);
}

TEST(TrialLogFile, BadFilesAreRefused) {
  const TemporaryFolder folder("badlog");
  const auto file = folder.path() / "t.json.gz";
  const auto refusal = [&](const std::string& text) {
    support::write_gzip(file, text);
    return tests::input_error_of([&] { (void)records::read_trial_log(file); });
  };
  EXPECT_THAT(refusal("{"), HasSubstr("t.json.gz"));
  EXPECT_THAT(refusal("{}"), HasSubstr("schema"));
  records::write_trial_log(file, a_log());
  const std::string good = support::read_gzip(file);
  EXPECT_EQ(refusal(good), "no error");
  std::string other = good;
  other.replace(other.find("trial_log/1"), 11, "trial_log/9");
  EXPECT_THAT(refusal(other), HasSubstr("trial_log/9"));
  std::string late = good;
  late.replace(late.find("[8,1.5"), 2, "[88");
  EXPECT_THAT(refusal(late), HasSubstr("not there"));
  std::string typo = good;
  typo.replace(typo.find("goal_reached"), 12, "goal_raeched");
  EXPECT_THAT(refusal(typo),
              HasSubstr("t.json.gz: stop_reason: expected a stop reason (goal_"));
  EXPECT_THAT(refusal(typo), testing::EndsWith("found \"goal_raeched\""));
}

TEST(Explanation, MomentsAreInOrderAndMerged) {
  const std::vector<results::KeyMoment> moments = results::key_moments(a_row(), a_log());
  ASSERT_EQ(moments.size(), 5U);
  EXPECT_EQ(moments[0].tick, 6);
  EXPECT_EQ(moments[0].what, "first in view");
  EXPECT_EQ(moments[1].tick, 8);
  EXPECT_EQ(moments[1].what, "first false detection");
  EXPECT_EQ(moments[2].tick, 9);
  EXPECT_EQ(moments[2].what, "first detected");
  EXPECT_EQ(moments[3].tick, 12);
  EXPECT_EQ(moments[3].what, "turning point");
  EXPECT_EQ(moments[4].tick, 19);
  records::TrialRow at_once = a_row();
  at_once.why.first_true_tick = 6;
  EXPECT_EQ(results::key_moments(at_once, a_log())[0].what, "first in view, first detected");
}

TEST(Explanation, TheStoryTellsWhatHappened) {
  const std::vector<std::string> lines = results::tell_story(a_row(), a_log());
  EXPECT_THAT(lines.front(), HasSubstr("Trial 17: tiny/couch/00, arm before: FAILED"));
  for (const char* part :
       {"find a couch in Two rooms", "false_positive: it took something else",
        "couch first in view (200 px of instance 1)",
        "something else reported as couch (score 0.6", "couch first detected (score 0.75",
        "drives to what it takes for the goal", "touches something",
        "STOP (goal_reached), 3.1 m from a view point",
        "in view in 2 of 20 images, detected in 1", "recall 0.50", "first 3 ticks after",
        "habitat-hm3d no"}) {
    EXPECT_THAT(lines, Contains(HasSubstr(part)));
  }
  // Events stand in order of time.
  double before_s = -1.0;
  for (const std::string& line : lines) {
    const std::size_t tick = line.find(" s  tick ");
    if (tick == std::string::npos) continue;
    const double time_s = std::stod(line.substr(0, tick));
    EXPECT_GE(time_s, before_s) << line;
    before_s = time_s;
  }
  EXPECT_EQ(before_s, 19.0);
}

TEST(Explanation, ASuccessHasNoCause) {
  records::TrialRow row = a_row();
  row.success = true;
  row.outcome = records::TrialOutcome::kSuccess;
  row.why.cause = records::Cause::kDidNotFail;
  row.why.inevitable_tick = row.why.decisive_tick = -1;
  const std::vector<std::string> lines = results::tell_story(row, a_log());
  EXPECT_THAT(lines.front(), HasSubstr("SUCCESS"));
  EXPECT_THAT(lines, testing::Not(Contains(HasSubstr("  cause "))));
}

TEST(Explanation, LongStoriesAreShortened) {
  records::TrialLog log = a_log();
  for (std::size_t k = 0; k + 1 < log.track.size(); ++k) {
    log.track[k].mode = k % 2 == 0 ? core::PolicyMode::kExplore : core::PolicyMode::kRecover;
  }
  EXPECT_THAT(results::tell_story(a_row(), log), Contains(HasSubstr("(7 more changes")));
}

TEST(Explanation, PicturesShowTheRoomAndTheMoments) {
  const TemporaryFolder folder("story");
  const core::SceneBundle bundle =
      core::load_bundle(TinyScene().write(folder.path() / "tiny"));
  const auto surfels = std::make_shared<renderer::SurfelCloud>(TinyScene().surfels());
  const auto renderer = renderer::make_cpu_renderer(surfels, {});
  const drawing::FloorPlan plan = drawing::make_floor_plan(*surfels);
  const core::Image<core::Rgb8> map =
      results::draw_story_map(a_row(), a_log(), bundle.manifest, plan);
  records::TrialRow other = a_row();
  other.why.decisive_tick = 2;  // Another mark.
  EXPECT_GT(map.width_px(), 700);
  const core::Image<core::Rgb8> moved =
      results::draw_story_map(other, a_log(), bundle.manifest, plan);
  ASSERT_EQ(map.size(), moved.size());
  EXPECT_FALSE(std::equal(map.pixels().begin(), map.pixels().end(), moved.pixels().begin()));
  const core::Image<core::Rgb8> frames =
      results::draw_story_frames(a_row(), a_log(), bundle.manifest, *renderer);
  EXPECT_GE(frames.width_px(), 3 * 480);  // Three columns of pictures 480 wide.
  EXPECT_GE(frames.height_px(), 2 * 360);
}

}  // namespace
}  // namespace segsim::experiments
