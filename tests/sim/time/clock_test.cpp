#include "sim/time/clock.h"

#include <gtest/gtest.h>

#include "core/check.h"

namespace segsim::sim {
namespace {

TEST(SensorRate, PeriodPhaseAndJitter) {
  SensorRate rate{50, 7, 0};
  EXPECT_EQ(rate.time_of(0, 1), 7);
  EXPECT_EQ(rate.time_of(3, 1), 157);
  rate = {50'000'000, 0, 20'000'000};
  core::TimeNs before_ns = -1;
  int different = 0;
  for (std::uint64_t k = 0; k < 1000; ++k) {
    const core::TimeNs t = rate.time_of(k, 1);
    EXPECT_GT(t, before_ns) << "captures keep their order";
    EXPECT_LE(std::abs(t - static_cast<core::TimeNs>(k) * 50'000'000), 20'000'000);
    EXPECT_EQ(rate.time_of(k, 1), t);
    different += rate.time_of(k, 2) != t ? 1 : 0;
    before_ns = t;
  }
  EXPECT_GT(different, 900) << "keyed by the episode";
  rate.jitter_ns = 25'000'000;
  EXPECT_THROW((void)rate.time_of(0, 1), core::ContractViolation);
}

TEST(TrialClock, WhatIsPlayedDependsOnTheMode) {
  TrialClock clock;
  StageBudget detect;
  detect.name = "detect";
  detect.duration.a_ms = 30;
  StageBudget map = detect;
  map.name = "map";
  StageBudget render = detect;
  render.name = "render";
  render.charge = Charge::kSim;
  clock.budget.stages = {detect, map, render};
  EXPECT_TRUE(clock.played_budget().stages.empty()) << "lockstep";
  clock.mode = ClockMode::kVirtual;
  EXPECT_EQ(clock.played_budget().find("detect")->duration.kind,
            DurationModel::Kind::kConstant);
  clock.mode = ClockMode::kMeasured;
  LatencyBudget played = clock.played_budget();
  EXPECT_EQ(played.find("detect")->duration.kind, DurationModel::Kind::kMeasured);
  EXPECT_EQ(played.find("map")->duration.kind, DurationModel::Kind::kConstant);
  EXPECT_EQ(played.find("render")->charge, Charge::kSim);
  clock.mode = ClockMode::kRealtime;
  EXPECT_EQ(clock.played_budget().find("render")->charge, Charge::kRobot);
  clock.budget = {};
  EXPECT_NE(clock.played_budget().find("policy"), nullptr) << "a budget of its own";
}

TEST(Pacer, HoldsSimulatedTimeBackAndCountsLateness) {
  core::TimeNs wall_ns = 1000;
  Pacer pacer([&] { return wall_ns; }, [&](core::TimeNs until_ns) { wall_ns = until_ns; });
  EXPECT_EQ(pacer.wait_until(0), 0);
  EXPECT_EQ(pacer.wait_until(100), 0);
  EXPECT_EQ(wall_ns, 1100);
  wall_ns += 250;  // The tick at 200 is late by 150 ...
  EXPECT_EQ(pacer.wait_until(200), 150);
  EXPECT_EQ(wall_ns, 1350);
  EXPECT_EQ(pacer.wait_until(400), 0) << "... and what is ahead is waited for";
  EXPECT_EQ(wall_ns, 1400);
}

TEST(Pacer, TheSteadyClockWaits) {
  const auto start = std::chrono::steady_clock::now();
  Pacer pacer;
  (void)pacer.wait_until(0);
  (void)pacer.wait_until(20'000'000);
  EXPECT_GE(std::chrono::steady_clock::now() - start, std::chrono::milliseconds(20));
}

}  // namespace
}  // namespace segsim::sim
