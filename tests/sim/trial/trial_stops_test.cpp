// What late commands, old images and stops on their way lead to.
#include <cmath>
#include <memory>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "tests/sim/trial/timed_trial.h"

namespace segsim::sim {
namespace {

using TrialStopsTest = TimedTrialTest;

TEST_F(TrialStopsTest, WhatALateCommandLeadsTo) {
  const auto ahead = [](const core::Observation&) { return command(0.5, 0.0); };
  play(0, 0, 0, 30);
  options_.clock.budget.end_to_end_deadline_ns = 30 * kMs;
  options_.time_limit_s = 2.0;
  const TrialResult in_time = run(ahead);
  EXPECT_EQ(in_time.timing.end_to_end.misses, 0) << "at the deadline is in time";

  options_.clock.budget.end_to_end_deadline_ns = 29 * kMs;
  LatencyBudget& budget = options_.clock.budget;
  budget.on_miss = OnMiss::kUseStale;
  const TrialResult stale = run(ahead);
  expect_same_ticks(stale, in_time);
  EXPECT_EQ(stale.timing.end_to_end.misses, stale.timing.end_to_end.response.count());
  EXPECT_EQ(stale.timing.end_to_end.longest_miss_run, stale.timing.end_to_end.misses);
  for (const OnMiss rule : {OnMiss::kDrop, OnMiss::kHold, OnMiss::kZeroCommand}) {
    budget.on_miss = rule;
    const TrialResult result = run(ahead);
    EXPECT_EQ(result.path_m, 0.0) << to_string(rule);
    EXPECT_EQ(result.outcome, Outcome::kTimeout);
    EXPECT_EQ(result.timing.end_to_end.misses, stale.timing.end_to_end.misses);
  }
  budget.on_miss = OnMiss::kAbort;
  const TrialResult aborted = run(ahead);
  EXPECT_EQ(aborted.outcome, Outcome::kAborted);
  EXPECT_NEAR(aborted.sim_s, 0.03, 1e-9);
}

/// Late from the 5th image on: the last command in time was half speed ahead.
TEST_F(TrialStopsTest, HoldGoesOnDropRunsIntoTheTimeoutZeroStops) {
  play(0, 0, 0, 0);
  auto trace = std::make_shared<LatencyTrace>();
  for (std::uint64_t tick = 0; tick < 30; ++tick) {
    trace->add("actuate", tick, tick < 5 ? 0 : 40 * kMs);
  }
  LatencyBudget& budget = options_.clock.budget;
  budget = with_trace(budget, trace);
  budget.end_to_end_deadline_ns = 20 * kMs;
  options_.time_limit_s = 2.9;
  const auto way_m = [&](OnMiss rule) {
    budget.on_miss = rule;
    return run([](const auto&) { return command(0.5, 0.0); }).path_m;
  };
  const double held_m = way_m(OnMiss::kHold);
  const double dropped_m = way_m(OnMiss::kDrop);
  const double stopped_m = way_m(OnMiss::kZeroCommand);
  EXPECT_NEAR(held_m, 0.5 * 2.9 - 0.5 * 0.5 * 0.25, 0.01) << "at speed after 0.25 s";
  // The last command is of 0.4 s. Stopped from 0.54 s on, or 0.25 s after 0.4 s.
  EXPECT_NEAR(stopped_m, 0.5 * 0.54 - 0.0625 + 0.0625, 0.01);
  EXPECT_NEAR(dropped_m, 0.5 * 0.65 - 0.0625 + 0.0625, 0.01);
}

TEST_F(TrialStopsTest, ImagesThatAreTooOldStopTheRobot) {
  play(0, 350, 0, 0);
  options_.clock.budget.max_age_ns = 300 * kMs;
  options_.time_limit_s = 3.0;
  const auto ahead = [](const core::Observation&) { return command(0.5, 0.0); };
  options_.clock.budget.on_max_age = OnMiss::kZeroCommand;
  EXPECT_EQ(run(ahead).path_m, 0.0);
  options_.clock.budget.on_max_age = OnMiss::kUseStale;
  EXPECT_GT(run(ahead).path_m, 0.5);
  options_.clock.budget.on_max_age = OnMiss::kAbort;
  EXPECT_EQ(run(ahead).outcome, Outcome::kAborted);
}

TEST_F(TrialStopsTest, AStopIsJudgedWhereTheRobotIsWhenItTakesEffect) {
  episode_.start = {10.0, 10.0, 0.0};
  episode_.view_points_m = {{12.0, 10.0}};
  options_.require_visible = false;
  options_.success_distance_m = 0.5;
  // STOP is decided on the image of 10.9 m ...
  const auto until = [](const core::Observation& seen) {
    core::Decision decision = command(0.8, 0.0);
    if (seen.T_odom_robot.translation_m().x > 10.9) {
      decision.stop = core::StopReason::kGoalReached;
    }
    return decision;
  };
  EXPECT_EQ(run(until).outcome, Outcome::kStoppedFar);
  // ... and a second later the robot has come near.
  play(0, 0, 1000, 0);
  const TrialResult late = run(until);
  EXPECT_EQ(late.outcome, Outcome::kSuccess);
  EXPECT_LT(late.distance_to_goal_m, 0.5);
}

TEST_F(TrialStopsTest, TheEndIsWhereTheStopTookEffectNotWhereItWasDecided) {
  episode_.start = {10.0, 10.0, 0.0};
  episode_.view_points_m = {{12.0, 10.0}};
  const auto until = [](const core::Observation& seen) {
    core::Decision decision = command(0.8, 0.0);
    if (seen.T_odom_robot.translation_m().x > 10.9) {
      decision.stop = core::StopReason::kGoalReached;
    }
    return decision;
  };
  play(0, 0, 1000, 0);
  const TrialResult late = run(until);
  // A second at full speed: the base does not run into its command timeout of 0.25 s, since
  // the last command is sent again until the STOP is due.
  EXPECT_NEAR(late.final_pose.x_m - late.track.back().pose.x_m, 0.8, 1e-6);
  EXPECT_NEAR(late.sim_s - core::seconds(late.track.back().time_ns), 1.0, 1e-9);
  EXPECT_NEAR(glm::distance(glm::dvec2(late.final_pose.x_m, late.final_pose.y_m),
                            episode_.view_points_m[0]),
              late.distance_to_goal_m, 0.03);
  // Without latency they are the same.
  play(0, 0, 0, 0);
  const TrialResult at_once = run(until);
  EXPECT_EQ(at_once.final_pose.x_m, at_once.track.back().pose.x_m);
}

TEST_F(TrialStopsTest, AnImageTooOldStopsTheRobotAlsoWhileItsStopIsOnTheWay) {
  const auto until = [](const core::Observation& seen) {
    core::Decision decision = command(0.8, 0.0);
    if (core::seconds(seen.capture_time_ns) > 1.0) {
      decision.stop = core::StopReason::kGoalReached;
    }
    return decision;
  };
  // Only the decision to stop, of tick 11, takes a second.
  play(0, 0, 0, 0);
  auto trace = std::make_shared<LatencyTrace>();
  for (std::uint64_t tick = 0; tick < 12; ++tick) {
    trace->add("policy", tick, tick < 11 ? 0 : 1000 * kMs);
  }
  options_.clock.budget = with_trace(options_.clock.budget, trace);
  const TrialResult rolls = run(until);
  options_.clock.budget.max_age_ns = 500 * kMs;
  options_.clock.budget.on_max_age = OnMiss::kZeroCommand;
  // Stopped at 1.7 s instead of 2.1 s, with 2 m/s^2.
  EXPECT_NEAR(rolls.path_m - run(until).path_m, 0.8 * 0.4 - 0.16, 0.01);
}

}  // namespace
}  // namespace segsim::sim
