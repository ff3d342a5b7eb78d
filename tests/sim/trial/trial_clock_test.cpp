// Trials in virtual and measured time: what late perception does to a robot.
#include <cmath>
#include <memory>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "tests/sim/trial/timed_trial.h"

namespace segsim::sim {
namespace {

using TrialClockTest = TimedTrialTest;

TEST_F(TrialClockTest, VirtualTimeWithoutLatenciesIsLockstepTickForTick) {
  const TrialResult lockstep = run(weave);
  play(0, 0, 0, 0);
  const TrialResult virtual_time = run(weave);
  ASSERT_GT(lockstep.path_m, 2.0);
  expect_same_ticks(lockstep, virtual_time);
  EXPECT_EQ(virtual_time.timing.age.max(), 0);
  EXPECT_EQ(virtual_time.timing.ticks_without_news, 0);
  // With a latency they differ.
  play(0, 0, 0, 5);
  EXPECT_NE(run(weave).state_hash, lockstep.state_hash);
}

TEST_F(TrialClockTest, AnEqualTrialIsEqual) {
  play(33, 80, 4, 8);
  options_.clock.budget.stages[1].duration.kind = DurationModel::Kind::kLognormal;
  options_.clock.budget.stages[1].duration.b_ms = 120;
  options_.clock.camera = {70 * kMs, 5 * kMs, 10 * kMs};
  const TrialResult first = run(weave);
  expect_same_ticks(first, run(weave));
  episode_.seed = 43;
  EXPECT_NE(run(weave).state_hash, first.state_hash);
}

TEST_F(TrialClockTest, TwoHundredMillisecondsOnDetectAreTwoHundredOfAge) {
  play(33, 30, 4, 8);
  const core::TimeNs tick_ns = std::llround(options_.control_period_s * 1e9);
  LatencyBudget& budget = options_.clock.budget;
  const auto rise_ns = [&](int servers) {
    budget.resources["gpu"] = servers;
    budget.find("detect")->duration.added_ms = 0;
    const TrialResult before = run(weave);
    EXPECT_EQ(before.timing.age.percentile(0.5), 100 * kMs) << "33 + 30 ms, so the next tick";
    budget.find("detect")->duration.added_ms = 200;
    const TrialResult after = run(weave);
    EXPECT_EQ(after.timing.find("detect")->drops > 10, servers == 1);
    if (servers == 1) {
      EXPECT_NEAR(after.timing.utilisation("gpu"), 1.0, 0.05);
    }
    return after.timing.age.percentile(0.5) - before.timing.age.percentile(0.5);
  };
  // Three images at a time: nothing waits, so the delay is all there is.
  EXPECT_NEAR(static_cast<double>(rise_ns(3)), 200.0 * kMs, static_cast<double>(tick_ns));
  // One at a time: images wait for the server, and each is in use for longer.
  const core::TimeNs alone_ns = rise_ns(1);
  EXPECT_GE(alone_ns, 200 * kMs);
  EXPECT_LE(alone_ns, 200 * kMs + 2 * tick_ns);
}

TEST_F(TrialClockTest, TheWorkedTimelineOfTheDesignHoldsInATrial) {
  play(33, 80, 0, 0);
  LatencyBudget& budget = options_.clock.budget;
  budget.stages.push_back(stage("segment", 25, "gpu"));
  budget.stages.back().after = {"detect"};
  budget.stages.push_back(stage("map", 10, "gpu"));
  budget.stages.back().after = {"segment"};
  options_.control_period_s = 0.05;
  options_.time_limit_s = 0.6;
  const TrialResult result = run(weave);
  const std::vector<std::int64_t> captures_ms = {-50, -50, -50, 0,   0,   0,  100,
                                                 100, 200, 200, 300, 300, 300};
  ASSERT_EQ(result.track.size(), captures_ms.size());
  for (std::size_t k = 0; k < captures_ms.size(); ++k) {
    EXPECT_EQ(result.track[k].capture_index * 50, captures_ms[k]) << 50 * k << " ms";
    if (captures_ms[k] < 0) continue;
    const auto age_ms = static_cast<std::int64_t>(50 * k) - captures_ms[k];
    EXPECT_EQ(result.track[k].age_ns, age_ms * kMs) << 50 * k << " ms";
  }
  EXPECT_EQ(result.timing.ticks_without_image, 3);
}

TEST_F(TrialClockTest, ACommandTakesEffectBetweenTicks) {
  // Tick 0: full speed, due at 37 ms. 2 m/s^2 for the 63 ms that are left of the tick.
  play(0, 0, 12, 25);
  robot_.max_acceleration_mps2 = 2.0;
  options_.time_limit_s = 0.1;
  const TrialResult result = run([](const auto&) { return command(0.8, 0.0); });
  // Velocity changes at the beginning of a substep: the first lasts 3 ms, then 12 of 5 ms.
  double v = 0.0, way_m = 0.0;
  for (int k = 0; k < 13; ++k) {
    const double h = k == 0 ? 0.003 : 0.005;
    v += 2.0 * h;
    way_m += v * h;
  }
  EXPECT_NEAR(result.path_m, way_m, 1e-12);
  EXPECT_EQ(result.timing.end_to_end.response.max(), 37 * kMs);
}

TEST_F(TrialClockTest, MeasuredTimesPlayedAsATraceGiveTheSameTrial) {
  options_.clock.mode = ClockMode::kMeasured;
  options_.clock.measured_scale = 40.0;
  options_.time_limit_s = 4.0;
  const TrialResult measured = run(weave);
  EXPECT_GE(measured.timing.find("detect")->response.percentile(0.0), 40 * kMs)
      << "1 ms, forty times";
  ASSERT_TRUE(measured.trace.has("detect"));
  ASSERT_TRUE(measured.trace.has("policy"));

  TrialClock replay;
  replay.mode = ClockMode::kVirtual;
  replay.budget = with_trace(options_.clock.played_budget(),
                             std::make_shared<LatencyTrace>(measured.trace));
  options_.clock = replay;
  const TrialResult again = run(weave);
  expect_same_ticks(measured, again);
  EXPECT_EQ(again.trace, measured.trace);
}

TEST_F(TrialClockTest, TimePerDetectionIsCharged) {
  play(0, 10, 0, 0);
  options_.clock.budget.stages.push_back(stage("segment", 1, "gpu"));
  options_.clock.budget.stages.back().after = {"detect"};
  options_.clock.budget.stages.back().duration.per_item_ms = 6;
  detector_.found_ = 3;
  EXPECT_EQ(run(weave).timing.find("segment")->response.max(), 19 * kMs);
}

// A label at 3 m, placed with the pose of the tick, is off by 2 r sin(w age / 2).
TEST_F(TrialClockTest, RegistrationAtUseMovesLabelsByTheFormula) {
  play(0, 150, 0, 0);
  options_.clock.budget.find("detect")->on = "";  // No queue: each image is 150 ms late.
  const auto turn = [](const core::Observation&) { return command(0.0, 1.0); };
  for (const Registration registration : {Registration::kCapture, Registration::kUse}) {
    options_.clock.registration = registration;
    NotingPolicy policy(turn);
    const TrialResult result = run(policy);
    std::size_t decided = 0;
    for (std::size_t k = 0; k < result.track.size(); ++k) {
      const TickRecord& tick = result.track[k];
      if (!tick.fresh) continue;
      const core::Pose2 shown = policy.poses_[decided++];
      if (k < 20) continue;  // Until the turn is steady.
      const core::TimeNs capture_ns = tick.time_ns - tick.age_ns;
      const core::Pose2 then =
          result.track[static_cast<std::size_t>(capture_ns / (100 * kMs))].pose;
      const auto label = [](const core::Pose2& p) {
        return glm::dvec2(p.x_m + 3.0 * std::cos(p.yaw_rad),
                          p.y_m + 3.0 * std::sin(p.yaw_rad));
      };
      const double off_m = glm::distance(label(shown), label(then));
      const double expected_m = registration == Registration::kCapture
                                    ? 0.0
                                    : 6.0 * std::sin(0.5 * core::seconds(tick.age_ns));
      ASSERT_NEAR(off_m, expected_m, 1e-6) << "tick " << k;
      EXPECT_EQ(tick.age_ns, 200 * kMs);
    }
    EXPECT_GT(decided, 30U);
  }
  EXPECT_NEAR(6.0 * std::sin(0.1), 0.599, 5e-4) << "the figure of docs/simulation.md";
}

/// Without a capture latency, images arrive at the very moment at which a server of 50 ms jobs
/// becomes free. It takes the newest, so nothing waits.
TEST_F(TrialClockTest, AServerThatBecomesFreeTakesTheImageOfThatMoment) {
  play(0, 100, 0, 0);
  options_.control_period_s = 0.05;
  options_.time_limit_s = 2.0;
  const TrialResult result = run(weave);
  int with_image = 0;
  for (const TickRecord& tick : result.track) {
    if (tick.capture_index < 0) continue;
    ++with_image;
    // 0 at 100, 100 at 200, ...: the image between is displaced by that of the moment.
    ASSERT_EQ(tick.capture_index % 2, 0) << tick.time_ns / kMs << " ms";
    EXPECT_EQ(tick.age_ns, (tick.time_ns / kMs % 100 == 0 ? 100 : 150) * kMs);
  }
  EXPECT_GT(with_image, 30);
  EXPECT_EQ(result.timing.find("detect")->response.max(), 100 * kMs) << "no image waited";
}

TEST_F(TrialClockTest, RealTimeTakesItsTime) {
  options_.clock.mode = ClockMode::kRealtime;
  options_.time_limit_s = 0.5;
  const TrialResult result = run(weave);
  EXPECT_GE(result.wall_s, 0.49);
  EXPECT_GT(result.timing.age.max(), 0);
}

}  // namespace
}  // namespace segsim::sim
