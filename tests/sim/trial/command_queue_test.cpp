#include "sim/trial/internal/command_queue.h"

#include <gtest/gtest.h>

namespace segsim::sim::internal {
namespace {

using Kind = BaseOrder::Kind;
constexpr core::TimeNs kMs = 1'000'000;

core::Decision ahead(double forward_mps) {
  return {{forward_mps, 0.0}, core::PolicyMode::kExplore};
}

LatencyBudget deadline_of(core::TimeNs deadline_ns, OnMiss rule) {
  LatencyBudget budget;
  budget.end_to_end_deadline_ns = deadline_ns;
  budget.on_miss = rule;
  return budget;
}

LatencyBudget largest_age_of(core::TimeNs age_ns, OnMiss rule) {
  LatencyBudget budget;
  budget.max_age_ns = age_ns;
  budget.on_max_age = rule;
  return budget;
}

TEST(CommandQueue, WithoutRulesEveryCommandTakesEffect) {
  CommandQueue queue{LatencyBudget{}};
  queue.send(3, ahead(0.5), 300 * kMs, 310 * kMs);
  EXPECT_TRUE(queue.on_its_way(3));
  const BaseOrder order = queue.arrive(3, 900 * kMs);
  EXPECT_EQ(order.kind, Kind::kDrive);
  EXPECT_EQ(order.command.forward_mps, 0.5);
  EXPECT_FALSE(queue.on_its_way(3));
  EXPECT_EQ(queue.check_age(10'000 * kMs).kind, Kind::kNothing);
  EXPECT_EQ(queue.repeat().kind, Kind::kSendAgain);
  EXPECT_EQ(queue.end_to_end().response.values_ns(), std::vector<core::TimeNs>{600 * kMs});
  EXPECT_EQ(queue.end_to_end().misses, 0);
}

TEST(CommandQueue, TheDeadlinesRuleAnswersForALateCommand) {
  const std::pair<OnMiss, Kind> answers[] = {{OnMiss::kUseStale, Kind::kDrive},
                                             {OnMiss::kDrop, Kind::kNothing},
                                             {OnMiss::kHold, Kind::kSendAgain},
                                             {OnMiss::kZeroCommand, Kind::kDrive},
                                             {OnMiss::kAbort, Kind::kAbort}};
  for (const auto& [rule, kind] : answers) {
    CommandQueue queue(deadline_of(100 * kMs, rule));
    queue.send(0, ahead(0.5), 0, 0);
    const BaseOrder in_time = queue.arrive(0, 100 * kMs);
    EXPECT_EQ(in_time.kind, Kind::kDrive) << "at the deadline is in time";
    EXPECT_EQ(in_time.command.forward_mps, 0.5);
    queue.send(1, ahead(0.5), 0, 0);
    const BaseOrder late = queue.arrive(1, 100 * kMs + 1);
    EXPECT_EQ(late.kind, kind) << to_string(rule);
    EXPECT_EQ(late.command.forward_mps, rule == OnMiss::kUseStale ? 0.5 : 0.0);
    EXPECT_EQ(queue.end_to_end().misses, 1) << "counted whatever the rule";
  }
}

TEST(CommandQueue, OnlyTheRuleDropRefusesAnImageBeforehand) {
  for (const OnMiss rule : {OnMiss::kUseStale, OnMiss::kHold, OnMiss::kAbort}) {
    CommandQueue queue(deadline_of(100 * kMs, rule));
    EXPECT_FALSE(queue.refuses(500 * kMs)) << to_string(rule);
  }
  EXPECT_FALSE(CommandQueue(deadline_of(0, OnMiss::kDrop)).refuses(500 * kMs));
  CommandQueue queue(deadline_of(100 * kMs, OnMiss::kDrop));
  EXPECT_FALSE(queue.refuses(100 * kMs));
  EXPECT_EQ(queue.end_to_end().response.count(), 0);
  EXPECT_TRUE(queue.refuses(101 * kMs));
  EXPECT_EQ(queue.end_to_end().misses, 1);
  EXPECT_EQ(queue.repeat().kind, Kind::kNothing) << "the base runs into its timeout";
  queue.send(0, ahead(0.5), 0, 0);
  EXPECT_EQ(queue.repeat().kind, Kind::kSendAgain);
}

TEST(CommandQueue, AnOldImageTakesTheCommandsThatRestOnIt) {
  CommandQueue queue(largest_age_of(300 * kMs, OnMiss::kZeroCommand));
  queue.send(0, ahead(0.5), 0, 100 * kMs);
  EXPECT_EQ(queue.check_age(300 * kMs).kind, Kind::kNothing) << "not older than the largest";
  const BaseOrder stop = queue.check_age(301 * kMs);
  EXPECT_EQ(stop.kind, Kind::kDrive);
  EXPECT_EQ(stop.command.forward_mps, 0.0);
  EXPECT_EQ(queue.repeat().kind, Kind::kNothing);
  EXPECT_EQ(queue.arrive(0, 400 * kMs).kind, Kind::kNothing) << "the rule has answered";
  // Decided on an image that was too old by then: the same, though nobody asked for its age.
  queue.send(1, ahead(0.5), 0, 500 * kMs);
  EXPECT_EQ(queue.arrive(1, 500 * kMs).kind, Kind::kNothing);
  queue.send(2, ahead(0.5), 500 * kMs, 500 * kMs);
  EXPECT_EQ(queue.arrive(2, 500 * kMs).kind, Kind::kDrive);
}

TEST(CommandQueue, TheRuleHoldKeepsTheOldCommandUp) {
  CommandQueue queue(largest_age_of(300 * kMs, OnMiss::kHold));
  EXPECT_EQ(queue.check_age(301 * kMs).kind, Kind::kSendAgain);
  EXPECT_EQ(queue.repeat().kind, Kind::kSendAgain);
}

TEST(CommandQueue, AnAgeThatIsNotMindedChangesNothing) {
  CommandQueue queue(largest_age_of(300 * kMs, OnMiss::kUseStale));
  queue.send(0, ahead(0.5), 0, 900 * kMs);
  EXPECT_EQ(queue.check_age(900 * kMs).kind, Kind::kNothing);
  EXPECT_EQ(queue.arrive(0, 950 * kMs).kind, Kind::kDrive);
}

TEST(CommandQueue, ACommandThatWasOvertakenHasNoEffect) {
  CommandQueue queue{LatencyBudget{}};
  queue.send(4, ahead(0.4), 0, 0);
  queue.send(5, ahead(0.5), 0, 0);
  EXPECT_EQ(queue.arrive(5, 10 * kMs).command.forward_mps, 0.5);
  EXPECT_EQ(queue.arrive(4, 20 * kMs).kind, Kind::kNothing);
  EXPECT_EQ(queue.end_to_end().response.count(), 2) << "but it arrived, and counts";
}

TEST(CommandQueue, AStopTakesEffectHoweverLate) {
  CommandQueue queue(deadline_of(100 * kMs, OnMiss::kDrop));
  core::Decision decision = ahead(0.0);
  decision.stop = core::StopReason::kStuck;
  queue.send(7, decision, 0, 0);
  const BaseOrder order = queue.arrive(7, 900 * kMs);
  EXPECT_EQ(order.kind, Kind::kStop);
  EXPECT_EQ(order.stop, core::StopReason::kStuck);
}

}  // namespace
}  // namespace segsim::sim::internal
