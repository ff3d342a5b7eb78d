#include "experiments/results/timing_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "experiments/records/store.h"
#include "experiments/runs/budget_measure.h"
#include "experiments/runs/budget_sweep.h"
#include "experiments/specs/budget_file.h"
#include "sim/time/budget_play.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;

sim::TimingReport report_of(int good, int late) {
  sim::TimingReport timing;
  timing.stages.emplace_back();
  timing.stages[0].name = "detect";
  timing.stages[0].deadline_ns = 50'000'000;
  for (int k = 0; k < good; ++k) timing.stages[0].add(40'000'000);
  for (int k = 0; k < late; ++k) timing.stages[0].add(60'000'000);
  timing.end_to_end.name = "end_to_end";
  timing.resources["gpu"] = {2, 500};
  timing.span_ns = 1000;
  return timing;
}

TEST(TimingReport, ADeadlineHoldsIfTheUpperBoundDoes) {
  // Wilson: 0 of 100 -> at most 3.70 %; 0 of 500 -> 0.76 %.
  std::vector<results::DeadlineCheck> checks =
      results::check_deadlines(report_of(100, 0), 0.01);
  ASSERT_EQ(checks.size(), 1U);
  EXPECT_NEAR(checks[0].interval.high, 0.0370, 1e-4);
  EXPECT_FALSE(checks[0].holds) << "100 good ones do not show a rate below 1 %";
  checks = results::check_deadlines(report_of(500, 0), 0.01);
  EXPECT_NEAR(checks[0].interval.high, 0.00762, 1e-5);
  EXPECT_TRUE(checks[0].holds);
  checks = results::check_deadlines(report_of(500, 4), 0.01);
  EXPECT_FALSE(checks[0].holds);
  EXPECT_EQ(checks[0].longest_run, 4);
  const std::vector<results::DeadlineCheck> nothing =
      results::check_deadlines(report_of(0, 0), 1.0);
  EXPECT_FALSE(nothing[0].holds) << "nothing is no proof";
  EXPECT_THAT(results::format_checks(nothing, 1.0),
              HasSubstr("detect within 50.0 ms: never ran"));
  EXPECT_THAT(results::format_checks(checks, 0.01), HasSubstr("FAILS  detect within 50.0 ms"));
}

TEST(TimingReport, TextAndJsonHaveTheFigures) {
  const sim::TimingReport timing = report_of(3, 1);
  const std::string text = results::format_timing(timing);
  EXPECT_THAT(text, HasSubstr("25.00 %"));
  EXPECT_THAT(text, HasSubstr("gpu: 25.0 % busy (2 servers)"));
  const auto json = nlohmann::json::parse(results::timing_json(timing));
  EXPECT_EQ(json["stages"]["detect"]["misses"], 1);
  EXPECT_EQ(json["stages"]["detect"]["max_ms"], 60.0);
  EXPECT_EQ(json["utilisation"]["gpu"], 0.25);
}

TEST(TimingReport, ReportsAddUp) {
  sim::TimingReport sum = report_of(3, 2);
  sum.append(report_of(1, 1));
  EXPECT_EQ(sum.stages[0].response.count(), 7);
  EXPECT_EQ(sum.stages[0].misses, 3);
  EXPECT_EQ(sum.stages[0].longest_miss_run, 2) << "a run ends with its trial";
  EXPECT_EQ(sum.span_ns, 2000);
}

TEST(BudgetPlay, AServerThatBecomesFreeTakesTheImageOfThatMoment) {
  sim::TrialClock clock;
  clock.mode = sim::ClockMode::kVirtual;
  clock.budget.resources = {{"gpu", 1}};
  clock.budget.stages.emplace_back();
  clock.budget.stages[0].name = "detect";
  clock.budget.stages[0].on = "gpu";
  clock.budget.stages[0].duration.a_ms = 100;
  sim::BudgetPlayOptions options;
  options.control_period_ns = 50'000'000;
  options.duration_ns = 2 * core::kNsPerSecond;
  const sim::TimingReport timing = sim::play_budget(clock, options);
  EXPECT_EQ(timing.find("detect")->response.max(), 100'000'000) << "no image waited";
  EXPECT_EQ(timing.age.percentile(0.0), 100'000'000);
  EXPECT_EQ(timing.age.max(), 150'000'000);
}

TEST(BudgetPlay, WorkedTimelineAges) {
  sim::TrialClock clock;
  clock.mode = sim::ClockMode::kVirtual;
  clock.budget =
      specs::read_budget_file(std::filesystem::path(SEGSIM_BUDGETS) / "worked-timeline.yaml")
          .budget;
  sim::BudgetPlayOptions options;
  options.control_period_ns = 50'000'000;
  options.duration_ns = 600'000'000;
  const sim::TimingReport timing = sim::play_budget(clock, options);
  std::vector<core::TimeNs> ages_ms;
  for (const core::TimeNs age_ns : timing.age.values_ns())
    ages_ms.push_back(age_ns / 1'000'000);
  EXPECT_THAT(ages_ms, testing::ElementsAre(150, 200, 250, 200, 250, 200, 250, 200, 250, 300));
  EXPECT_EQ(timing.find("detect")->drops, 6);
}

TEST(BudgetPlay, TwoHundredMillisecondsOnDetect) {
  sim::TrialClock clock;
  clock.mode = sim::ClockMode::kVirtual;
  clock.budget =
      specs::read_budget_file(std::filesystem::path(SEGSIM_BUDGETS) / "example-edge.yaml")
          .budget;
  // With servers enough nothing waits, and the delay is all there is. One server alone also
  // takes fewer images, so what is in use grows older by more than the delay.
  for (const int servers : {4, 1}) {
    clock.budget.resources["gpu"] = servers;
    clock.budget.find("detect")->duration.added_ms = 0;
    const sim::TimingReport before = sim::play_budget(clock, {});
    clock.budget.find("detect")->duration.added_ms = 200;
    const sim::TimingReport after = sim::play_budget(clock, {});
    const double rise_ms =
        sim::ms_from_ns(after.age.percentile(0.5) - before.age.percentile(0.5));
    if (servers == 4) {
      EXPECT_NEAR(rise_ms, 200.0, 100.0) << "one tick";
    } else {
      EXPECT_GT(rise_ms, 200.0);
    }
    EXPECT_GT(after.find("detect")->misses, after.find("detect")->response.count() / 2);
  }
}

/// `successes` of ten episodes succeed, the first ones.
void add_trials(std::vector<records::TrialRow>& rows, const std::string& arm, int successes) {
  for (int k = 0; k < 10; ++k) {
    records::TrialRow row;
    row.arm = arm;
    row.scene = "flat";
    row.episode = "e" + std::to_string(k);
    row.outcome =
        k < successes ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
    row.success = k < successes;
    rows.push_back(row);
  }
}

TEST(BudgetSweep, TheMarginIsTheLastDelayWithinDelta) {
  runs::SweepOptions options;
  options.add_ms = {0, 100, 200, 400};
  options.delta = 0.1;
  std::vector<records::TrialRow> rows;
  add_trials(rows, "before+0ms", 9);
  add_trials(rows, "before+100ms", 8);
  add_trials(rows, "before+200ms", 5);
  add_trials(rows, "before+400ms", 9);
  const runs::SweepResult result = runs::summarise_sweep(options, "before", rows);
  ASSERT_EQ(result.points.size(), 4U);
  EXPECT_EQ(result.points[2].success.successes, 5);
  EXPECT_NEAR(result.points[2].loss.difference, -0.4, 1e-12);
  EXPECT_EQ(result.margin_ms, 100.0) << "what comes after the first loss does not count";
  EXPECT_EQ(result.safe_margin_ms, std::nullopt) << "ten episodes prove nothing";
  EXPECT_THAT(runs::format_sweep(result, options),
              HasSubstr("Latency margin of detect: 100 ms"));

  // A failed harness is left out of the pairs.
  rows[0].outcome = records::TrialOutcome::kError;
  EXPECT_EQ(runs::summarise_sweep(options, "before", rows).points[0].success.trials, 9);

  const auto picture = runs::draw_sweep(result, options, "test");
  EXPECT_GT(picture.width_px(), 400);
}

TEST(BudgetMeasure, WhatStagesTookIsABudgetThatCanBePlayed) {
  sim::LatencyTrace trace;
  for (std::uint64_t k = 0; k < 101; ++k) {
    trace.add("detect", k, static_cast<core::TimeNs>(1'000'000 + 10'000 * k));  // 1 to 2 ms
    trace.add("policy", k, 3'000'000);
  }
  runs::StageDurations durations;
  runs::add_durations(trace, durations);
  const runs::MeasuredBudget about{"here", "a processor", 2, true};
  const std::string text = runs::budget_text(about, durations);
  EXPECT_THAT(text, HasSubstr("# a processor"));
  const sim::LatencyBudget budget = specs::parse_budget(text, "here.yaml").budget;
  EXPECT_EQ(budget.id, "here");
  const sim::StageBudget* detect = budget.find("detect");
  ASSERT_NE(detect, nullptr);
  EXPECT_EQ(detect->on, "gpu");
  EXPECT_EQ(detect->duration.kind, sim::DurationModel::Kind::kLognormal);
  EXPECT_NEAR(detect->duration.a_ms, 1.5, 1e-9);
  EXPECT_NEAR(detect->duration.b_ms, 1.95, 1e-9);
  const sim::StageBudget* policy = budget.find("policy");
  ASSERT_NE(policy, nullptr);
  EXPECT_EQ(policy->on, "cpu");
  EXPECT_EQ(policy->duration.kind, sim::DurationModel::Kind::kConstant);
  EXPECT_NEAR(policy->duration.a_ms, 3.0, 1e-9);
  EXPECT_THROW((void)runs::budget_text(about, {}), core::InputError);
}

TEST(BudgetMeasure, OneArmRunsInMeasuredTime) {
  specs::ExperimentSpec spec;
  spec.sha256 = "spec";
  spec.arms.resize(2);
  spec.arms[0].name = "before";
  spec.arms[1].name = "after";
  spec.repetitions.trials = 5;
  const specs::ExperimentSpec measured = runs::measured_spec(spec, "after");
  ASSERT_EQ(measured.arms.size(), 1U);
  EXPECT_EQ(measured.arms[0].name, "after.measured");
  EXPECT_EQ(measured.clock.mode, sim::ClockMode::kMeasured);
  EXPECT_EQ(measured.repetitions.trials, 1);
  EXPECT_NE(measured.sha256, spec.sha256);
  EXPECT_EQ(runs::measured_spec(spec, "").arms[0].name, "before.measured");
  EXPECT_THROW((void)runs::measured_spec(spec, "afters"), core::InputError);
}

}  // namespace
}  // namespace segsim::experiments
