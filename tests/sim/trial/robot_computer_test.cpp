#include "sim/trial/internal/robot_computer.h"

#include <gtest/gtest.h>

#include "tests/sim/trial/timed_trial.h"

namespace segsim::sim::internal {
namespace {

/// Finds as many things in an image as its number says, and counts its calls.
class CountingDetector final : public core::Detector {
 public:
  const std::vector<std::string>& class_names() const override { return names_; }
  std::vector<core::Detection> detect(const core::Observation& seen) override {
    asked_.push_back(seen.capture_index);
    return std::vector<core::Detection>(seen.capture_index, core::Detection{0, 0.5F, {}});
  }
  std::vector<std::uint64_t> asked_;

 private:
  std::vector<std::string> names_{"couch"};
};

class RobotComputerTest : public TimedTrialTest {
 protected:
  RobotComputerTest()
      : renderer_({}),
        policy_(weave),
        eye_({.episode = episode_,
              .options = options_,
              .world = world_,
              .robot = robot_,
              .renderer = renderer_,
              .detector = detector_,
              .policy = policy_}) {}

  Capture& take(core::TimeNs time_ns) { return eye_.take(time_ns, {}, {}, {}); }

  BoxRenderer renderer_;
  NotingPolicy policy_;
  CountingDetector detector_;
  TrialEye eye_;
};

TEST_F(RobotComputerTest, InLockstepNothingTakesTimeAndDetectionWaitsForThePolicy) {
  RobotComputer computer(options_, 1, eye_);
  computer.take_in(take(0));
  EXPECT_TRUE(computer.compute_until(0).empty());
  ASSERT_NE(eye_.ready(), nullptr);
  EXPECT_TRUE(detector_.asked_.empty());
  Capture& used = eye_.use_ready();
  EXPECT_EQ(eye_.detections_of(used).size(), 0U);
  (void)eye_.detections_of(used);
  EXPECT_EQ(detector_.asked_, std::vector<std::uint64_t>{0}) << "once, however often asked";
  computer.decided(0, 0, 123);
  const auto effects = computer.compute_until(0);
  ASSERT_EQ(effects.size(), 1U);
  EXPECT_EQ(effects[0].time_ns, 0);
  EXPECT_TRUE(computer.trace().empty());
}

TEST_F(RobotComputerTest, TheStageDetectStartsDetectionAndItsItemsCount) {
  play(0, 50, 20, 8);
  LatencyBudget& budget = options_.clock.budget;
  budget.stages.push_back(stage("segment", 10, "gpu"));
  budget.stages.back().after = {"detect"};
  budget.stages.back().duration.per_item_ms = 5;
  RobotComputer computer(options_, 1, eye_);
  (void)take(0);  // Image 0 is not given to the computer.
  computer.take_in(take(100 * kMs));
  (void)computer.compute_until(100 * kMs);
  EXPECT_EQ(detector_.asked_, std::vector<std::uint64_t>{1}) << "when the stage begins";
  EXPECT_EQ(eye_.ready(), nullptr);
  (void)computer.compute_until(164 * kMs);
  EXPECT_EQ(eye_.ready(), nullptr);
  (void)computer.compute_until(165 * kMs);  // 50 ms, then 10 ms and 5 ms for the one thing.
  ASSERT_NE(eye_.ready(), nullptr);
  (void)eye_.detections_of(eye_.use_ready());
  EXPECT_EQ(detector_.asked_.size(), 1U) << "known already";
  EXPECT_EQ(computer.trace().at("segment", 1), 15 * kMs);

  computer.decided(200 * kMs, 2, 0);
  EXPECT_TRUE(computer.deciding());
  EXPECT_TRUE(computer.compute_until(227 * kMs).empty());
  EXPECT_FALSE(computer.deciding());
  const auto effects = computer.compute_until(228 * kMs);
  ASSERT_EQ(effects.size(), 1U);
  EXPECT_EQ(effects[0].tick, 2U);
  EXPECT_EQ(effects[0].time_ns, 228 * kMs);
}

TEST_F(RobotComputerTest, WhatThePolicyTookIsScaledAndFaultsAreAdded) {
  options_.clock.mode = ClockMode::kMeasured;
  options_.clock.measured_scale = 40.0;
  options_.faults.latencies = {{"policy", 0, 100 * kMs, 7 * kMs}};
  RobotComputer computer(options_, 1, eye_);
  computer.decided(0, 0, kMs);
  (void)computer.compute_until(90 * kMs);
  computer.decided(100 * kMs, 1, 2 * kMs);
  (void)computer.compute_until(100 * kMs);
  EXPECT_EQ(computer.trace().at("policy", 0), 47 * kMs);
  EXPECT_EQ(computer.trace().at("policy", 1), 80 * kMs) << "the fault is over";
}

TEST_F(RobotComputerTest, AnImageThatAQueueGivesUpIsNeverReady) {
  play(0, 100, 0, 0);
  RobotComputer computer(options_, 1, eye_);
  for (int k = 0; k < 3; ++k) {
    const core::TimeNs time_ns = k * 20 * kMs;
    (void)computer.compute_until(time_ns - 1);
    computer.take_in(take(time_ns));
  }
  // 0 is worked on, 1 waits and gives way to 2.
  (void)computer.compute_until(1000 * kMs);
  EXPECT_EQ(detector_.asked_, (std::vector<std::uint64_t>{0, 2}));
  ASSERT_NE(eye_.ready(), nullptr);
  EXPECT_EQ(eye_.ready()->index, 2U);
  TimingReport report;
  computer.report(report);
  EXPECT_EQ(report.find("detect")->drops, 1);
}

}  // namespace
}  // namespace segsim::sim::internal
