#include "sim/time/schedule.h"

#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim {
namespace {

using testing::ElementsAre;

constexpr core::TimeNs kMs = 1'000'000;

StageBudget stage(const std::string& name, double ms, const std::string& on = "",
                  std::vector<std::string> after = {}) {
  StageBudget made;
  made.name = name;
  made.on = on;
  made.after = std::move(after);
  made.duration.a_ms = ms;
  return made;
}

/// Capture 33 ms, then three stages one after another on one resource.
LatencyBudget serial_budget(double detect_ms, double segment_ms, double map_ms) {
  LatencyBudget budget;
  budget.resources = {{"gpu", 1}};
  budget.stages = {stage("capture", 33), stage("detect", detect_ms, "gpu", {"capture"}),
                   stage("segment", segment_ms, "gpu", {"detect"}),
                   stage("map", map_ms, "gpu", {"segment"})};
  return budget;
}

Schedule::Work constant_work() {
  return [](const StageBudget& s, std::uint64_t index) {
    return s.duration.draw(s.name, 0, index, 0);
  };
}

struct Played {
  std::vector<std::vector<core::TimeNs>> processed_ms;  ///< {capture, start, done}
  std::vector<core::TimeNs> dropped_ms;                 ///< Capture times.
  std::vector<core::TimeNs> in_use_ms;                  ///< By tick; -1: none.
};

/// A camera of 50 ms, ticks of 50 ms, `ticks` of them.
Played play(const LatencyBudget& budget, int ticks) {
  std::map<std::uint64_t, core::TimeNs> started_ms;
  core::TimeNs now_ns = 0;
  Schedule* running = nullptr;
  std::vector<std::uint64_t> begun;
  Schedule schedule(budget, [&](const StageBudget& s, std::uint64_t index) {
    if (s.name == "detect") begun.push_back(index);
    return s.duration.draw(s.name, 0, index, 0);
  });
  running = &schedule;
  Played played;
  core::TimeNs newest_ns = -1;
  for (int tick = 0; tick < ticks; ++tick) {
    now_ns = tick * 50 * kMs;
    running->capture(now_ns, static_cast<std::uint64_t>(tick));
    // In steps of 1 ms, to see when the first stage begins.
    for (core::TimeNs t = now_ns; t < now_ns + 50 * kMs; t += kMs) {
      running->advance_to(t);
      for (const std::uint64_t index : begun) started_ms[index] = t / kMs;
      begun.clear();
      for (const Schedule::Result& result : running->take_results()) {
        played.processed_ms.push_back(
            {result.capture_ns / kMs, started_ms[result.index], result.done_ns / kMs});
        newest_ns = std::max(newest_ns, result.capture_ns);
        EXPECT_EQ(result.done_ns % kMs, 0);
      }
      for (const std::uint64_t index : running->take_dropped()) {
        played.dropped_ms.push_back(static_cast<core::TimeNs>(index) * 50);
      }
      if (t == now_ns) played.in_use_ms.push_back(newest_ns < 0 ? -1 : newest_ns / kMs);
    }
  }
  return played;
}

// The worked timeline of docs/simulation.md, exact to the nanosecond.
TEST(Schedule, WorkedTimelineOfASlowPipeline) {
  const Played played = play(serial_budget(80, 25, 10), 13);
  using V = std::vector<core::TimeNs>;
  EXPECT_THAT(played.processed_ms,
              ElementsAre(V{0, 33, 148}, V{100, 148, 263}, V{200, 263, 378}, V{300, 378, 493},
                          V{450, 493, 608}));
  EXPECT_THAT(played.dropped_ms, ElementsAre(50, 150, 250, 350, 400, 500));
  // t = 0, 50, ..., 600: the capture that is in use.
  EXPECT_THAT(played.in_use_ms,
              ElementsAre(-1, -1, -1, 0, 0, 0, 100, 100, 200, 200, 300, 300, 300));
}

TEST(Schedule, WorkedTimelineOfAFastPipeline) {
  const Played played = play(serial_budget(12, 8, 5), 13);
  EXPECT_TRUE(played.dropped_ms.empty());
  for (std::size_t k = 0; k < played.processed_ms.size(); ++k) {
    EXPECT_EQ(played.processed_ms[k][2], static_cast<core::TimeNs>(58 + 50 * k));
  }
  // Ages settle at 100 ms.
  for (std::size_t tick = 2; tick < played.in_use_ms.size(); ++tick) {
    EXPECT_EQ(static_cast<core::TimeNs>(50 * tick) - played.in_use_ms[tick], 100);
  }
}

TEST(Schedule, WithoutStagesEverythingIsAtOnce) {
  Schedule schedule({}, constant_work());
  schedule.capture(7, 0);
  schedule.decide(7, 3);
  schedule.advance_to(7);
  const auto results = schedule.take_results();
  const auto effects = schedule.take_effects();
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0].done_ns, 7);
  ASSERT_EQ(effects.size(), 1U);
  EXPECT_EQ(effects[0].time_ns, 7);
  EXPECT_EQ(effects[0].tick, 3U);
  EXPECT_FALSE(schedule.deciding());
}

TEST(Schedule, StagesOfNoTimeOnOneServerAreDoneAtOnce) {
  LatencyBudget budget = serial_budget(0, 0, 0);
  budget.stages[0].duration.a_ms = 0;
  Schedule schedule(budget, constant_work());
  for (int k = 0; k < 5; ++k) {
    schedule.capture(k * 50 * kMs, static_cast<std::uint64_t>(k));
    schedule.advance_to(k * 50 * kMs);
    const auto results = schedule.take_results();
    ASSERT_EQ(results.size(), 1U);
    EXPECT_EQ(results[0].done_ns, k * 50 * kMs);
  }
}

TEST(Schedule, TheCommandComesAfterPolicyAndActuation) {
  LatencyBudget budget;
  budget.resources = {{"cpu", 1}};
  budget.stages = {stage("policy", 4, "cpu"), stage("actuate", 8)};
  Schedule schedule(budget, constant_work());
  schedule.advance_to(100 * kMs);
  schedule.decide(100 * kMs, 1);
  schedule.advance_to(104 * kMs - 1);
  EXPECT_TRUE(schedule.deciding());
  schedule.advance_to(104 * kMs);
  EXPECT_FALSE(schedule.deciding());
  EXPECT_TRUE(schedule.take_effects().empty());
  schedule.advance_to(200 * kMs);
  const auto effects = schedule.take_effects();
  ASSERT_EQ(effects.size(), 1U);
  EXPECT_EQ(effects[0].time_ns, 112 * kMs);
  EXPECT_THROW((schedule.decide(0, 2)), core::ContractViolation);
}

TEST(Schedule, QueueRules) {
  // One stage of 100 ms; captures at 0, 10, 20, 30.
  const auto processed = [](QueueRule rule, int depth) {
    LatencyBudget budget;
    budget.resources = {{"gpu", 1}};
    budget.stages = {stage("detect", 100, "gpu")};
    budget.stages[0].queue = rule;
    budget.stages[0].queue_depth = depth;
    Schedule schedule(budget, constant_work());
    for (std::uint64_t k = 0; k < 4; ++k) {
      schedule.advance_to(static_cast<core::TimeNs>(k) * 10 * kMs);
      schedule.capture(static_cast<core::TimeNs>(k) * 10 * kMs, k);
    }
    schedule.advance_to(1000 * kMs);
    std::vector<std::uint64_t> order;
    for (const auto& result : schedule.take_results()) order.push_back(result.index);
    TimingReport report;
    schedule.report(report);
    EXPECT_EQ(report.stages[0].drops, 4 - static_cast<int>(order.size()));
    EXPECT_EQ(report.resources["gpu"].busy_ns,
              static_cast<core::TimeNs>(order.size()) * 100 * kMs);
    return order;
  };
  EXPECT_THAT(processed(QueueRule::kNewest, 1), ElementsAre(0, 3));
  EXPECT_THAT(processed(QueueRule::kNewest, 2), ElementsAre(0, 2, 3));
  EXPECT_THAT(processed(QueueRule::kDropNew, 1), ElementsAre(0, 1));
  EXPECT_THAT(processed(QueueRule::kFifo, 64), ElementsAre(0, 1, 2, 3));
}

TEST(Schedule, SeveralServersWorkSideBySide) {
  LatencyBudget budget;
  budget.resources = {{"gpu", 2}};
  budget.stages = {stage("detect", 90, "gpu")};
  Schedule schedule(budget, constant_work());
  for (std::uint64_t k = 0; k < 4; ++k) {
    schedule.capture(static_cast<core::TimeNs>(k) * 50 * kMs, k);
    schedule.advance_to(static_cast<core::TimeNs>(k) * 50 * kMs);
  }
  schedule.advance_to(1000 * kMs);
  std::vector<core::TimeNs> done_ms;
  for (const auto& result : schedule.take_results()) done_ms.push_back(result.done_ns / kMs);
  EXPECT_THAT(done_ms, ElementsAre(90, 140, 190, 240));
}

TEST(Schedule, BranchesJoin) {
  // detect (30, gpu) and map (50, cpu) side by side; fuse (5) after both.
  LatencyBudget budget;
  budget.resources = {{"gpu", 1}, {"cpu", 1}};
  budget.stages = {stage("fuse", 5, "cpu", {"detect", "map"}),
                   stage("detect", 30, "gpu", {"capture"}), stage("map", 50, "cpu")};
  Schedule schedule(budget, constant_work());
  schedule.capture(0, 0);
  schedule.advance_to(1000 * kMs);
  const auto results = schedule.take_results();
  ASSERT_EQ(results.size(), 1U);
  EXPECT_EQ(results[0].done_ns, 55 * kMs);
}

TEST(Schedule, StagesChargedToTheSimulatorTakeNoSimulatedTime) {
  LatencyBudget budget = serial_budget(80, 25, 10);
  budget.stages.push_back(stage("render", 500, "", {"capture"}));
  budget.stages.back().charge = Charge::kSim;
  EXPECT_EQ(play(budget, 13).processed_ms, play(serial_budget(80, 25, 10), 13).processed_ms);
}

TEST(Schedule, DeadlinesAndRunsOfMisses) {
  LatencyBudget budget;
  budget.stages = {stage("detect", 0)};
  budget.stages[0].deadline_ns = 20 * kMs;
  const std::vector<int> durations_ms = {10, 21, 30, 20, 25, 25, 25, 5};
  Schedule schedule(budget, [&](const StageBudget&, std::uint64_t index) {
    return durations_ms[index] * kMs;
  });
  for (std::uint64_t k = 0; k < durations_ms.size(); ++k) {
    schedule.capture(static_cast<core::TimeNs>(k) * 100 * kMs, k);
    schedule.advance_to(static_cast<core::TimeNs>(k + 1) * 100 * kMs - 1);
  }
  TimingReport report;
  schedule.report(report);
  EXPECT_EQ(report.stages[0].misses, 5) << "at exactly the deadline is in time";
  EXPECT_EQ(report.stages[0].longest_miss_run, 3);
  EXPECT_EQ(report.stages[0].response.percentile(0.5), 21 * kMs);
  EXPECT_EQ(report.stages[0].response.max(), 30 * kMs);
}

/// A slow twin for one resource and one queue of depth one: what the newest-wins rule means,
/// written as a loop over images.
TEST(Schedule, NewestWinsAgreesWithALoopOverImages) {
  core::RandomStream random(5, "schedule_test");
  for (int round = 0; round < 200; ++round) {
    std::vector<core::TimeNs> capture_ns, work_ns;
    core::TimeNs t = 0;
    for (int k = 0; k < 40; ++k) {
      t += 1 + random.index(1000);
      capture_ns.push_back(t);
      work_ns.push_back(1 + random.index(2500));
    }
    std::vector<std::pair<std::uint64_t, core::TimeNs>> expected;
    core::TimeNs free_ns = 0;
    for (std::size_t k = 0; k < capture_ns.size();) {
      const core::TimeNs start_ns = std::max(free_ns, capture_ns[k]);
      // Of those that came until then the last one is taken.
      std::size_t last = k;
      while (last + 1 < capture_ns.size() && capture_ns[last + 1] <= start_ns) ++last;
      free_ns = start_ns + work_ns[last];
      expected.emplace_back(last, free_ns);
      k = last + 1;
    }
    LatencyBudget budget;
    budget.resources = {{"gpu", 1}};
    budget.stages = {stage("detect", 0, "gpu")};
    Schedule schedule(budget, [&](const StageBudget&, std::uint64_t i) { return work_ns[i]; });
    for (std::uint64_t k = 0; k < capture_ns.size(); ++k) {
      schedule.advance_to(capture_ns[k] - 1);
      schedule.capture(capture_ns[k], k);
    }
    schedule.advance_to(10'000'000);
    std::vector<std::pair<std::uint64_t, core::TimeNs>> found;
    for (const auto& r : schedule.take_results()) found.emplace_back(r.index, r.done_ns);
    ASSERT_EQ(found, expected) << "round " << round;
  }
}

TEST(LatencyBudget, ProblemsAreNamed) {
  const auto problem = [](std::vector<StageBudget> stages) {
    LatencyBudget budget;
    budget.resources = {{"gpu", 1}};
    budget.stages = std::move(stages);
    return budget.problem();
  };
  EXPECT_EQ(problem({stage("detect", 1, "gpu"), stage("map", 1, "", {"detect"})}), "");
  EXPECT_THAT(problem({stage("detect", 1, "tpu")}), testing::HasSubstr("tpu"));
  EXPECT_THAT(problem({stage("detect", 1), stage("detect", 1)}), testing::HasSubstr("twice"));
  EXPECT_THAT(problem({stage("detect", 1, "", {"mask"})}), testing::HasSubstr("mask"));
  EXPECT_THAT(problem({stage("a", 1, "", {"b"}), stage("b", 1, "", {"a"})}),
              testing::HasSubstr("waits for itself"));
  EXPECT_THAT(problem({stage("policy", 1), stage("map", 1, "", {"policy"})}),
              testing::HasSubstr("after policy"));
  EXPECT_THAT(problem({stage("capture", 1, "gpu")}), testing::HasSubstr("no resource"));
}

TEST(DurationModel, DistributionsHaveTheirPercentiles) {
  DurationModel model;
  model.kind = DurationModel::Kind::kLognormal;
  model.a_ms = 28;
  model.b_ms = 41;
  DurationSamples samples;
  for (std::uint64_t k = 0; k < 20000; ++k) samples.add(model.draw("detect", 9, k, 0));
  EXPECT_NEAR(ms_from_ns(samples.percentile(0.5)), 28.0, 0.3);
  EXPECT_NEAR(ms_from_ns(samples.percentile(0.95)), 41.0, 0.8);
  model.kind = DurationModel::Kind::kUniform;
  for (std::uint64_t k = 0; k < 1000; ++k) {
    const double ms = ms_from_ns(model.draw("detect", 9, k, 0));
    EXPECT_GE(ms, 28.0);
    EXPECT_LT(ms, 41.0);
  }
  // Per item and added time come on top; never below zero.
  model = {};
  model.a_ms = 5;
  model.per_item_ms = 6;
  model.added_ms = 200;
  EXPECT_EQ(model.draw("segment", 9, 0, 3), 223 * kMs);
  model.added_ms = -300;
  EXPECT_EQ(model.draw("segment", 9, 0, 3), 0);
}

TEST(DurationModel, DrawsAreKeyedByEpisodeStageAndIndex) {
  DurationModel model;
  model.kind = DurationModel::Kind::kNormal;
  model.a_ms = 50;
  model.b_ms = 5;
  const core::TimeNs drawn = model.draw("detect", 1, 7, 0);
  EXPECT_EQ(model.draw("detect", 1, 7, 0), drawn);
  EXPECT_NE(model.draw("detect", 2, 7, 0), drawn);
  EXPECT_NE(model.draw("segment", 1, 7, 0), drawn);
  EXPECT_NE(model.draw("detect", 1, 8, 0), drawn);
}

TEST(LatencyTrace, GivesWhatWasRecordedAndGoesRound) {
  LatencyTrace trace;
  trace.add("detect", 4, 44);
  trace.add("detect", 0, 40);
  trace.add("detect", 2, 42);
  EXPECT_EQ(trace.at("detect", 2), 42);
  EXPECT_EQ(trace.at("detect", 4), 44);
  EXPECT_EQ(trace.at("detect", 3), 40) << "3 mod 3 = 0";
  EXPECT_EQ(trace.at("detect", 7), 42) << "7 mod 3 = 1";
  EXPECT_FALSE(trace.has("policy"));
}

TEST(DurationSamples, PercentilesAreNearestRanks) {
  DurationSamples samples;
  EXPECT_EQ(samples.percentile(0.5), 0);
  for (const core::TimeNs v : {50, 10, 40, 20, 30}) samples.add(v);
  EXPECT_EQ(samples.percentile(0.0), 10);
  EXPECT_EQ(samples.percentile(0.5), 30);
  EXPECT_EQ(samples.percentile(0.8), 40);
  EXPECT_EQ(samples.percentile(0.81), 50);
  EXPECT_EQ(samples.max(), 50);
}

}  // namespace
}  // namespace segsim::sim
