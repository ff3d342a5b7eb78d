// A trial is described once (experiments/records/trial_row.h); here is what is made from that.
#include "experiments/records/trial_row.h"

#include <algorithm>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "experiments/records/results_digest.h"
#include "experiments/records/store.h"
#include "experiments/results/trial_export.h"
#include "tests/experiments/records/column_values.h"

namespace segsim::experiments {
namespace {

using testing::ElementsAre;
using testing::UnorderedElementsAre;

/// A trial as an earlier program stored it; its digest and its line of CSV are recorded below.
records::TrialRow recorded_trial() {
  records::TrialRow t;
  t.trial_id = 41;
  t.arm = "after";
  t.scene = "flat, upstairs";
  t.episode = "flat/chair/07";
  t.goal_class = "chair";
  t.repetition = 2;
  t.outcome = records::TrialOutcome::kTimeout;
  t.success = true;
  t.stop_reason = core::StopReason::kGoalReached;
  t.spl = 0.1;
  t.soft_spl = 0.7;
  t.path_m = 12.3456789;
  t.shortest_path_m = 4.0;
  t.distance_to_goal_m = 1.0 / 3.0;
  t.sim_s = 120.5;
  t.wall_s = 3.25;
  t.ticks = 601;
  t.contacts = 3;
  t.contact_s = 0.4;
  t.first_visible_tick = 17;
  t.first_detected_tick = 19;
  t.invalid_pixel_fraction = 0.015625;
  t.state_hash = 0xfedcba9876543210ULL;
  t.render_ms = 1.5;
  t.detect_ms = 2.5;
  t.policy_ms = 3.5;
  t.error = "said \"no\"";
  t.picture = "pictures/a.png";
  t.video = "videos/a.mp4";
  t.track = "tracks/a";
  t.log = "logs/a.json.gz";
  t.finished = "2026-01-01T00:00:00Z";
  t.why.cause = records::Cause::kFalsePositive;
  t.why.inevitable_tick = 590;
  t.why.decisive_tick = 580;
  t.why.images = 150;
  t.why.visible_frames = 21;
  t.why.detected_frames = 20;
  t.why.true_detections = 22;
  t.why.false_detections = 5;
  t.why.first_true_tick = 23;
  t.why.true_clouds = 6;
  t.why.false_clouds = 7;
  t.why.misplaced_clouds = 8;
  t.why.stopped = true;
  t.why.final_visible_px = 1234;
  t.why.object_m = 0.75;
  t.why.shortest_object_m = 3.9;
  t.why.collision_ticks = 9;
  t.why.off_navmesh_ticks = 10;
  t.why.reached_instance = 11;
  t.why.stop_views = 12;
  return t;
}

/// One that is older than attributions, and has nothing to say.
records::TrialRow bare_trial() {
  records::TrialRow t;
  t.arm = "before";
  t.episode = "flat/chair/08";
  t.outcome = records::TrialOutcome::kSuccess;
  return t;
}

TEST(TrialColumns, EveryMemberIsVisited) {
  const records::TrialRow bare;
  std::size_t of_trial = 0, of_why = 0;
  records::visit_columns(bare, [&](const records::Column& column, const auto&) {
    ++(column.part == records::Part::kWhy ? of_why : of_trial);
  });
  EXPECT_EQ(of_trial + 1, count_members<records::TrialRow>()) << "`why` is one member";
  EXPECT_EQ(of_why, count_members<records::Attribution>());
  EXPECT_EQ(values_of(records::TrialRow{}).size(), of_trial + of_why)
      << "a name is given twice";
}

TEST(TrialColumns, DigestsAreTheRecordedOnes) {
  EXPECT_EQ(records::essence_of(recorded_trial()),
            "flat, upstairs\tflat/chair/07\tchair\tafter\ttimeout\tgoal_reached\tsaid "
            "\"no\"\tfalse_positive\t2\t1\tfedcba9876543210\t0x1.999999999999ap-4\t"
            "0x1.6666666666666p-1\t0x1.8b0fcd324d5a2p+3\t0x1p+2\t0x1.e2p+6\t"
            "0x1.999999999999ap-2\t0x1p-6\t0x1.5555555555555p-2\t0x1.8p-1\tnone\t"
            "0x1.f333333333333p+1\t601\t3\t17\t19\t150\t590\t580\t21\t20\t22\t5\t23\t6\t7\t1\t"
            "1234\t9\t10\t11\t8");
  EXPECT_EQ(records::results_sha256({recorded_trial(), bare_trial()}),
            "e336e7c04eb8f40fe23f8241cd5dc808ed4f96c672d9018ceb7c68b7f9abbf64");
}

TEST(TrialColumns, PlacesInTheDigestAreGivenOnce) {
  const records::TrialRow bare;
  std::vector<std::size_t> places;
  records::visit_columns(bare, [&](const records::Column& column, const auto&) {
    if (column.digest == records::kNotInDigest) return;
    places.push_back(static_cast<std::size_t>(column.digest));
  });
  std::sort(places.begin(), places.end());
  for (std::size_t k = 0; k < places.size(); ++k) EXPECT_EQ(places[k], k);
}

/// Everything but ids, times of the wall clock, and names of files.
TEST(TrialColumns, TheDigestLeavesOutWhatDependsOnTheMachine) {
  const records::TrialRow row = with_distinct_values<records::TrialRow>();
  std::vector<std::string> left_out;
  int number = 1001;
  records::visit_columns(row, [&](const records::Column& column, const auto& /*value*/) {
    records::TrialRow other = row;
    records::visit_columns(other, [&](const records::Column& each, auto& value) {
      if (std::string_view(each.name) == column.name) set_value(each, number++, value);
    });
    if (records::essence_of(other) == records::essence_of(row))
      left_out.emplace_back(column.name);
  });
  EXPECT_THAT(left_out, UnorderedElementsAre("trial_id", "wall_s", "render_ms", "detect_ms",
                                             "policy_ms", "stop_views", "log", "picture",
                                             "video", "track", "finished"));
}

std::vector<std::string> lines_of(const std::string& text) {
  std::istringstream in(text);
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

TEST(TrialColumns, CsvIsTheRecordedOne) {
  std::ostringstream out;
  records::write_trials_csv(out, {recorded_trial(), bare_trial()});
  EXPECT_THAT(
      lines_of(out.str()),
      ElementsAre(
          "scene,episode,goal_class,repetition,arm,outcome,success,stop_reason,spl,soft_spl,"
          "path_m,shortest_path_m,distance_to_goal_m,sim_s,wall_s,ticks,contacts,contact_s,"
          "first_visible_tick,first_detected_tick,invalid_pixel_fraction,state_hash,render_ms,"
          "detect_ms,policy_ms,error,cause,inevitable_tick,decisive_tick,visible_frames,"
          "detected_frames,true_detections,false_detections,first_true_tick,true_clouds,"
          "false_clouds,stopped,final_visible_px,object_m,planar_m,shortest_object_m,"
          "collision_ticks,off_navmesh_ticks,reached_instance,images,misplaced_clouds,stop_"
          "views,"
          "trial_id,log,picture,video,track,finished",
          "\"flat, upstairs\",flat/chair/07,chair,2,after,timeout,1,goal_reached,0.1,0.7,"
          "12.3457,4,0.333333,120.5,3.25,601,3,0.4,17,19,0.015625,fedcba9876543210,1.5,2.5,"
          "3.5,\"said \"\"no\"\"\",false_positive,590,580,21,20,22,5,23,6,7,1,1234,0.75,,3.9,"
          "9,10,11,150,8,12,41,logs/a.json.gz,pictures/a.png,videos/a.mp4,tracks/a,"
          "2026-01-01T00:00:00Z",
          ",flat/chair/08,,0,before,success,0,,0,0,0,0,,0,0,0,0,0,-1,-1,0,0000000000000000,0,"
          "0,0,,,,,,,,,,,,,,,,,,,,,,,0,,,,,"));
}

TEST(TrialColumns, JsonLinesHaveEveryColumn) {
  results::StoredRun run;
  run.trials = {recorded_trial(), bare_trial()};
  std::ostringstream out;
  results::write_trials_jsonl(out, run);
  const nlohmann::json trial = nlohmann::json::parse(lines_of(out.str()).at(1));
  std::size_t found = 0;
  records::visit_columns(run.trials[0], [&](const records::Column& column,
                                            const auto& /*value*/) {
    found += (column.part == records::Part::kWhy ? trial["why"] : trial).count(column.name);
  });
  EXPECT_EQ(found, values_of(run.trials[0]).size());
  EXPECT_EQ(found, trial.size() - 1 + trial["why"].size());
  EXPECT_EQ(trial["state_hash"], "fedcba9876543210");
  EXPECT_EQ(trial["success"], true);
  EXPECT_EQ(trial["path_m"], 12.3456789);
  EXPECT_EQ(trial["why"]["stopped"], true);
  EXPECT_EQ(trial["why"]["misplaced_clouds"], 8);
  EXPECT_TRUE(trial["why"]["planar_m"].is_null());
}

/// Trials of earlier versions: what was not counted is nothing, not less than nothing.
TEST(TrialColumns, WhatIsNotKnownIsEmpty) {
  records::TrialRow trial = recorded_trial();
  trial.why.images = trial.why.misplaced_clouds = trial.why.stop_views = -1;
  std::ostringstream csv, jsonl;
  records::write_trials_csv(csv, {trial});
  EXPECT_THAT(csv.str(), testing::HasSubstr(",9,10,11,,,,41,"));
  results::StoredRun run;
  run.trials = {trial};
  results::write_trials_jsonl(jsonl, run);
  const nlohmann::json why = nlohmann::json::parse(lines_of(jsonl.str()).at(1))["why"];
  EXPECT_TRUE(why["images"].is_null());
  EXPECT_TRUE(why["misplaced_clouds"].is_null());
}

}  // namespace
}  // namespace segsim::experiments
