// Scripted trials: the file, the driver, and what is made of a drive.
#include "experiments/scripted_trials/scripted_trial.h"

#include <cmath>
#include <fstream>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "experiments/scripted_trials/geo_path.h"
#include "experiments/scripted_trials/internal/script_metrics.h"
#include "experiments/scripted_trials/scripted_run.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using tests::input_error_of;

/// The example of docs/trials.md, in two rooms.
const char* const kExample = R"(schema: segsim.trial/1
scene: tiny
robot: jackal-gentle
clock: {mode: virtual, control_hz: 20, budget: edge.yaml}
seed: 17
start: {pose: [-2.5, -1.2, 0.0]}
camera: {width: 96, height: 72}
steps:
  - goto:   {xy: [-2.0, 1.0], tolerance: 0.25, timeout_s: 40}
  - follow: {path: loop.geojson, speed: 0.6}
  - spin:   {deg: 360, rate: 0.8}
  - cmd:    {v: 0.2, w: 0.2, for_s: 2.5}
  - hold:   {for_s: 1.0}
  - find:   {category: chair, policy: frontier, profile: segsim-object, max_steps: 500}
faults:
  - at_s: 5.0
    latency: {stage: detect, add_ms: 200, for_s: 3.0}
  - at_s: 12.0
    drop_frames: {camera: front, count: 6}
expect:
  - {metric: collisions, max: 0}
  - {metric: obs_age_ms.p95, max: 150}
  - {metric: deadline_miss_rate, stage: e2e, max: 0.01}
record: {ticks: full, video: true, topdown: true, exr_every: 20}
)";
const char* const kBudget = R"(schema: segsim.budget/1
id: edge
resources: {gpu: 1, cpu: 1}
stages:
  capture: {ms: 20}
  detect:  {on: gpu, ms: 20, deadline_ms: 60}
  policy:  {on: cpu, ms: 4}
  actuate: {ms: 8}
end_to_end: {deadline_ms: 150}
)";

class ScriptedTrialTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("scripted");
    TinyScene().write(folder_->path() / "tiny");
    std::ofstream(folder_->path() / "edge.yaml") << kBudget;
    // Around (0.5, 1.5) in World: 49.9 N, 8.9 E is the origin of the tiny scene.
    const sim::LocalFrame frame({49.9, 8.9, 0.0, 0.0});
    std::ofstream geo(folder_->path() / "loop.geojson");
    geo << R"({"type": "FeatureCollection", "features": [
      {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [8.9, 49.9]}},
      {"type": "Feature", "properties": {}, "geometry": {"type": "LineString", "coordinates": [)";
    bool first = true;
    geo.precision(12);
    for (const glm::dvec2& p :
         {glm::dvec2(-1.5, 1.4), glm::dvec2(1.5, 1.4), glm::dvec2(1.5, 0.2),
          glm::dvec2(1.5, 1.4), glm::dvec2(-1.5, 1.4)}) {
      const sim::GeodeticPoint g = frame.to_geodetic({p, 0.0});
      geo << (first ? "" : ", ") << "[" << g.longitude_deg << ", " << g.latitude_deg << "]";
      first = false;
    }
    geo << "]}}]}";
  }
  static void TearDownTestSuite() { delete folder_; }

  static scripted_trials::ScriptedTrial parse(const std::string& text) {
    return scripted_trials::parse_scripted_trial(text, folder_->path() / "trial.yaml", {});
  }
  /// The example with one text replaced.
  static std::string changed(const std::string& from, const std::string& to) {
    std::string text = kExample;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
  }
  static std::string error_of(const std::string& text) {
    return input_error_of([&] { (void)parse(text); });
  }
  /// Steps, and what else a test wants, in the tiny scene.
  static scripted_trials::ScriptedTrial script(const std::string& steps,
                                               const std::string& more = {}) {
    return parse(
        "schema: segsim.trial/1\nscene: tiny\nstart: {pose: [-2.5, -1.2, 0.0]}\n"
        "camera: {width: 64, height: 48}\nclock: {mode: lockstep, control_hz: 20}\n" +
        more + "steps:\n" + steps);
  }
  static scripted_trials::ScriptedResult run(const scripted_trials::ScriptedTrial& trial,
                                             const std::string& name = "out") {
    scripted_trials::BoundScript bound = scripted_trials::bind_script(trial);
    return scripted_trials::run_script(bound, folder_->path() / name);
  }

  static TemporaryFolder* folder_;
};
TemporaryFolder* ScriptedTrialTest::folder_ = nullptr;

TEST_F(ScriptedTrialTest, TheExampleOfTheDesignIsRead) {
  const scripted_trials::ScriptedTrial trial = parse(kExample);
  EXPECT_EQ(trial.name, "trial");
  EXPECT_EQ(trial.scene.bundle, folder_->path() / "tiny");
  EXPECT_EQ(trial.control_period_s, 0.05);
  EXPECT_EQ(trial.clock.mode, sim::ClockMode::kVirtual);
  ASSERT_EQ(trial.steps.size(), 6U);
  EXPECT_EQ(trial.steps[0].kind, scripted_trials::StepKind::kGoto);
  EXPECT_EQ(std::get<glm::dvec2>(trial.steps[0].places[0]), glm::dvec2(-2.0, 1.0));
  EXPECT_EQ(trial.steps[0].timeout_s, 40.0);
  EXPECT_EQ(trial.steps[1].places.size(), 5U) << "points beside the line are marks";
  EXPECT_NEAR(trial.steps[2].angle_rad, 2.0 * std::numbers::pi, 1e-12);
  EXPECT_EQ(trial.steps[3].command.turn_radps, 0.2);
  EXPECT_EQ(trial.steps[5].category, "chair");
  EXPECT_EQ(trial.steps[5].policy.name(), "frontier");
  ASSERT_EQ(trial.faults.latencies.size(), 1U);
  EXPECT_EQ(trial.faults.latencies[0].until_ns, 8'000'000'000);
  EXPECT_EQ(trial.faults.latencies[0].added_ns, 200'000'000);
  ASSERT_EQ(trial.faults.frame_drops.size(), 1U);
  EXPECT_EQ(trial.faults.frame_drops[0].count, 6);
  EXPECT_EQ(trial.expectations[2].stage, "end_to_end");
  EXPECT_TRUE(trial.record.ticks && trial.record.video && trial.record.topdown);
  EXPECT_TRUE(trial.needs_colour());
}

TEST_F(ScriptedTrialTest, ErrorsNameTheLineAndTheNearestWord) {
  const struct {
    const char *from, *to, *line, *words;
  } cases[] = {
      {"robot: jackal-gentle", "robot: jackal-gentel", ":3: ", "jackal-gentle"},
      {"robot:", "robto:", ":3: ", "robot"},
      {"- goto: ", "- gto: ", ":9: ", "goto"},
      {"timeout_s: 40", "timeout: 40", ":9: ", "timeout_s"},
      {"xy: [-2.0, 1.0]", "xy: [-2.0]", ":9: ", "[x, y]"},
      {"xy: [-2.0, 1.0], ", "", ":9: ", "xy or latlon"},
      {"loop.geojson", "nothing.geojson", ":10: ", "nothing.geojson"},
      {"rate: 0.8", "rate: 0", ":11: ", "[0.05, 10]"},
      {"for_s: 1.0", "for: 1.0", ":13: ", "for_s"},
      {"profile: segsim-object", "profile: barn", ":14: ", "segsim-object"},
      {"stage: detect", "stage: detct", ":17: ", "detect"},
      {"drop_frames: {camera: front", "drop_frames: {camera: back", ":19: ", "front"},
      {"metric: collisions", "metric: colisions", ":21: ", "collisions"},
      {"{metric: collisions, max: 0}", "{metric: collisions}", ":21: ", "min, max"},
      {"stage: e2e", "stage: e3e", ":23: ", "e2e"},
      {"ticks: full", "ticks: all", ":24: ", "full"},
      {"control_hz: 20", "control_hz: 17", ":4: ", "200 / n"},
      {"pose: [-2.5, -1.2, 0.0]", "pose: [-2.5, -1.2]", ":6: ", "yaw"},
      {"schema: segsim.trial/1", "schema: segsim.trial/2", ":1: ", "segsim.trial/1"},
  };
  for (const auto& c : cases) {
    EXPECT_THAT(error_of(changed(c.from, c.to)),
                AllOf(HasSubstr(c.line), HasSubstr(c.words), HasSubstr("expected")))
        << c.to;
  }
  EXPECT_THAT(error_of(changed("mode: virtual, ", "mode: lockstep, ")), HasSubstr("lockstep"));
}

TEST_F(ScriptedTrialTest, PlacesOnTheGlobeAreThoseOfTheWorld) {
  // 10 m east and 20 m north of the origin.
  scripted_trials::ScriptedTrial trial = script("  - hold: {for_s: 0.1}\n");
  trial.steps[0].places = {sim::GeodeticPoint{49.9001798121, 8.9001391903, 123.0}};
  const sim::LocalFrame frame({49.9, 8.9, 0.0, 0.0});
  const sim::GeodeticPoint start = frame.to_geodetic({-2.5, -1.2, 0.0});
  trial.start = start;
  trial.start_heading = 0.5 * std::numbers::pi;  // East.
  const scripted_trials::BoundScript bound = scripted_trials::bind_script(trial);
  EXPECT_NEAR(bound.places_m[0][0].x, 10.0, 1e-3);
  EXPECT_NEAR(bound.places_m[0][0].y, 20.0, 1e-3);
  EXPECT_NEAR(bound.start.x_m, -2.5, 1e-6);
  EXPECT_NEAR(bound.start.y_m, -1.2, 1e-6);
  EXPECT_NEAR(bound.start.yaw_rad, 0.0, 1e-12);
  trial.start_heading = 0.0;  // North.
  EXPECT_NEAR(scripted_trials::bind_script(trial).start.yaw_rad, 0.5 * std::numbers::pi,
              1e-12);
}

TEST_F(ScriptedTrialTest, GeoJsonPaths) {
  const fs::path file = folder_->path() / "path.geojson";
  const auto read = [&](const std::string& text) {
    std::ofstream(file) << text;
    return scripted_trials::read_geojson_path(file);
  };
  const auto points = read(
      R"({"type": "FeatureCollection", "features": [
      {"type": "Feature", "geometry": {"type": "Point", "coordinates": [8.9, 49.9]}},
      {"type": "Feature", "geometry": {"type": "Point", "coordinates": [8.95, 49.91, 3]}}]})");
  ASSERT_EQ(points.size(), 2U);
  EXPECT_EQ(points[1].longitude_deg, 8.95);
  EXPECT_EQ(points[1].latitude_deg, 49.91);
  EXPECT_EQ(points[1].height_m, 3.0);
  EXPECT_EQ(read(R"({"type": "LineString", "coordinates": [[1, 2], [3, 4], [5, 6]]})").size(),
            3U);
  const auto refusal = [&](const std::string& text) {
    return input_error_of([&] { (void)read(text); });
  };
  EXPECT_THAT(refusal("no json"), HasSubstr("path.geojson: expected GeoJSON"));
  EXPECT_THAT(refusal(R"({"type": "LineString", "coordinates": [[1, 2]]})"), HasSubstr("two"));
  EXPECT_THAT(refusal(R"({"type": "LineString", "coordinates": [[1, 120], [3, 4]]})"),
              HasSubstr("[longitude, latitude]"));
  EXPECT_THAT(refusal(R"({"type": "LineString"})"), HasSubstr("expected GeoJSON"));
  EXPECT_THAT(refusal(R"({"type": "GeometryCollection", "geometries": [
      {"type": "LineString", "coordinates": [[1, 2], [3, 4]]},
      {"type": "LineString", "coordinates": [[1, 2], [3, 4]]}]})"),
              HasSubstr("one LineString"));
}

TEST_F(ScriptedTrialTest, WhatTheSceneDoesNotAllowIsRefused) {
  const auto refusal = [&](const scripted_trials::ScriptedTrial& trial) {
    return input_error_of([&] { (void)scripted_trials::bind_script(trial); });
  };
  EXPECT_THAT(refusal(script("  - goto: {xy: [30, 0]}\n")),
              AllOf(HasSubstr("trial.yaml:7"), HasSubstr("reach")));
  EXPECT_THAT(refusal(script("  - find: {category: chiar}\n")), HasSubstr("near: chair"));
  scripted_trials::ScriptedTrial in_wall = script("  - hold: {for_s: 1}\n");
  in_wall.start = glm::dvec2(0.0, 0.0);
  EXPECT_THAT(refusal(in_wall), HasSubstr("start"));
}

TEST_F(ScriptedTrialTest, StepsDoWhatTheySay) {
  const scripted_trials::ScriptedTrial trial = script(
      "  - spin: {deg: -90, rate: 0.6}\n"
      "  - hold: {for_s: 1.5}\n"
      "  - cmd: {v: -0.2, for_s: 1}\n"
      "  - goto: {xy: [2.0, 1.0], tolerance: 0.2}\n",
      "expect:\n  - {metric: collisions, max: 0}\n  - {metric: steps_done, min: 4}\n"
      "  - {metric: distance_to_goal_m, max: 0.25}\n  - {metric: max_speed_mps, max: 0.51}\n");
  const scripted_trials::ScriptedResult result = run(trial);
  EXPECT_TRUE(result.passed()) << scripted_trials::in_words(trial, result);
  ASSERT_EQ(result.steps.size(), 4U);
  EXPECT_NEAR(result.steps[0].finish.yaw_rad, -0.5 * std::numbers::pi, 0.06);
  EXPECT_NEAR(core::seconds(result.steps[1].end_ns - result.steps[1].begin_ns), 1.5, 1e-9);
  EXPECT_NEAR(core::seconds(result.steps[2].end_ns - result.steps[2].begin_ns), 1.0, 1e-9);
  EXPECT_NEAR(result.steps[2].finish.y_m - result.steps[2].begin.y_m, 0.2, 0.03)
      << "backwards, looking down";
  EXPECT_EQ(result.trial.stop_reason, core::StopReason::kScriptEnd);
  const std::string text = core::read_file(folder_->path() / "out" / "trial.json");
  const auto json = nlohmann::json::parse(text);
  EXPECT_EQ(json["passed"], true);
  EXPECT_EQ(json["steps"][3]["end"], "done");
  EXPECT_TRUE(fs::exists(folder_->path() / "out" / "trial.png"));
  EXPECT_TRUE(fs::exists(folder_->path() / "out" / "track.geojson"));
}

/// There and back along the same line, and round a square whose end is its beginning.
TEST_F(ScriptedTrialTest, PathsAreFollowedAsDrawn) {
  const scripted_trials::ScriptedTrial trial = script(
      "  - goto: {xy: [-1.5, 1.3], tolerance: 0.15}\n"
      "  - follow: {path: loop.geojson, speed: 0.4, tolerance: 0.15}\n"
      "  - follow: {xy: [[-1.5, 1.3], [-2.5, 1.0], [-2.5, -1], [-1, -1], [-1.5, 1.3]]}\n",
      "expect:\n  - {metric: path_error_m, max: 0.3}\n  - {metric: collisions, max: 0}\n");
  const scripted_trials::ScriptedResult result = run(trial);
  EXPECT_TRUE(result.passed()) << scripted_trials::in_words(trial, result);
  // 8.4 m there and back, some 8.5 m of the square, the way to it all.
  EXPECT_GT(result.trial.path_m, 17.0);
  EXPECT_LT(result.trial.path_m, 23.0);
}

TEST_F(ScriptedTrialTest, AStepThatIsNotDoneEndsTheTrial) {
  const scripted_trials::ScriptedTrial late =
      script("  - goto: {xy: [2.0, 1.0], timeout_s: 1}\n  - hold: {for_s: 1}\n");
  const scripted_trials::ScriptedResult result = run(late);
  EXPECT_FALSE(result.passed());
  EXPECT_EQ(result.steps_done, 0);
  EXPECT_EQ(result.failure, "step 1 (goto) timed_out");
  EXPECT_THAT(scripted_trials::in_words(late, result),
              HasSubstr("FAILS  step 1 (goto) timed_out"));
  EXPECT_EQ(result.trial.stop_reason, core::StopReason::kStepFailed);
  EXPECT_LT(result.trial.sim_s, 1.2);
  // Into the wall: contacts are counted, and the time limit ends it.
  const scripted_trials::ScriptedTrial pushing = script("  - cmd: {v: 0.5, for_s: 60}\n",
                                                        "time_limit_s: 5\nexpect:\n"
                                                        "  - {metric: collisions, max: 0}\n");
  const scripted_trials::ScriptedResult pushed = run(pushing);
  EXPECT_EQ(pushed.trial.contacts, 1);
  EXPECT_FALSE(pushed.verdicts[0].holds);
  EXPECT_EQ(pushed.failure, "step 1 (cmd) was not finished: timeout");
}

TEST_F(ScriptedTrialTest, FaultsAreFelt) {
  const auto text = [](const char* faults) {
    return std::string(
               "schema: segsim.trial/1\nscene: tiny\n"
               "start: {pose: [-2.5, -1.2, 0.0]}\ncamera: {width: 64, height: 48}\n"
               "clock: {mode: virtual, control_hz: 20, budget: edge.yaml}\n"
               "steps: [spin: {deg: 360, rate: 0.8}]\n"
               "record: {ticks: full}\n") +
           faults +
           "expect:\n"
           "  - {metric: obs_age_ms.max, max: 150}\n"
           "  - {metric: deadline_miss_rate, stage: detect, max: 0.0}\n"
           "  - {metric: stage_ms.p50, stage: detect, min: 20, max: 20}\n"
           "  - {metric: frames_dropped, max: 0}\n";
  };
  const scripted_trials::ScriptedTrial calm = parse(text(""));
  EXPECT_TRUE(run(calm).passed());
  const scripted_trials::ScriptedTrial slow =
      parse(text("faults: [{at_s: 2, latency: {stage: detect, add_ms: 200, for_s: 2}}]\n"));
  const scripted_trials::ScriptedResult felt = run(slow);
  EXPECT_FALSE(felt.verdicts[0].holds);
  EXPECT_FALSE(felt.verdicts[1].holds);
  EXPECT_TRUE(felt.verdicts[2].holds);
  EXPECT_TRUE(felt.verdicts[3].holds);
  EXPECT_TRUE(felt.failure.empty()) << felt.failure;
  const scripted_trials::ScriptedTrial blind =
      parse(text("faults: [{at_s: 2, drop_frames: {count: 10}}]\n"));
  const scripted_trials::ScriptedResult lost = run(blind, "lost");
  EXPECT_FALSE(lost.verdicts[0].holds);
  EXPECT_TRUE(lost.verdicts[1].holds);
  EXPECT_EQ(lost.verdicts[3].value, 10.0);
  const std::string ticks = core::read_file(folder_->path() / "lost" / "ticks.csv");
  EXPECT_EQ(std::count(ticks.begin(), ticks.end(), '\n'), lost.trial.ticks + 1);
}

TEST_F(ScriptedTrialTest, FindIsJudgedByItsProfile) {
  const scripted_trials::ScriptedTrial trial =
      script("  - find: {category: couch, policy: oracle-path}\n  - hold: {for_s: 0.5}\n",
             "expect: [{metric: finds, min: 1}]\n");
  const scripted_trials::ScriptedResult result = run(trial);
  EXPECT_TRUE(result.passed()) << scripted_trials::in_words(trial, result);
  ASSERT_EQ(result.finds.size(), 1U);
  EXPECT_LT(result.finds[0].view_point_m, 1.0);
  EXPECT_GE(result.finds[0].visible_px, 40);
  EXPECT_GT(result.finds[0].spl, 0.5);
  EXPECT_EQ(result.finds[0].stop, core::StopReason::kGoalReached);
  // A policy that stops at once has found nothing, and says so.
  const scripted_trials::ScriptedTrial blind =
      script("  - find: {category: couch, policy: {type: script, actions: [forward]}}\n");
  const scripted_trials::ScriptedResult nothing = run(blind);
  EXPECT_FALSE(nothing.passed());
  EXPECT_EQ(nothing.failure, "step 1 (find) not_found: script_end");
}

TEST_F(ScriptedTrialTest, AnExpectationWithoutANumberDoesNotHold) {
  const scripted_trials::ScriptedTrial trial =
      script("  - hold: {for_s: 0.2}\n",
             "expect:\n  - {metric: path_error_m, max: 1}\n"
             "  - {metric: deadline_miss_rate, stage: e2e, max: 1}\n");
  const scripted_trials::ScriptedResult result = run(trial);
  EXPECT_TRUE(result.failure.empty());
  EXPECT_FALSE(result.passed());
  EXPECT_FALSE(result.verdicts[0].value.has_value());
  EXPECT_FALSE(result.verdicts[1].value.has_value());
  EXPECT_THAT(scripted_trials::in_words(trial, result),
              HasSubstr("path_error_m <= 1: not measured"));
}

TEST_F(ScriptedTrialTest, EqualScriptsGiveEqualDrives) {
  const scripted_trials::ScriptedTrial trial =
      script("  - goto: {xy: [1.0, 1.2]}\n", "localisation: odom\n");
  const scripted_trials::ScriptedResult a = run(trial), b = run(trial);
  EXPECT_EQ(a.trial.state_hash, b.trial.state_hash);
  EXPECT_GT(a.trial.path_m, 2.0);
  // On the navigation mesh it is another drive.
  scripted_trials::ScriptedTrial point = trial;
  point.collision = sim::CollisionMode::kNavmesh;
  EXPECT_TRUE(run(point).passed());
}

}  // namespace
}  // namespace segsim::experiments
