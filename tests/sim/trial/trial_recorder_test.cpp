#include "sim/trial/internal/trial_recorder.h"

#include <gtest/gtest.h>

namespace segsim::sim::internal {
namespace {

constexpr core::TimeNs kMs = 1'000'000;

class NoPolicy final : public core::Policy {
 public:
  void reset(const core::ObjectGoal&, std::uint64_t) override {}
  core::Decision decide(const core::Observation&, std::span<const core::Detection>) override {
    return {};
  }
  core::PolicyView view() const override { return {}; }
};

/// An image of 100 ms in which the goal was detected once, and something else once.
Capture detected_image() {
  Capture capture;
  capture.index = 4;
  capture.time_ns = 100 * kMs;
  capture.goal = {60, 50};
  capture.detections = {{1, 0.9F, {}}, {0, 0.8F, {}}};
  capture.detections_hash = 77;
  return capture;
}

TickRecord tick_at(core::TimeNs time_ns, bool fresh) {
  TickRecord tick;
  tick.time_ns = time_ns;
  tick.fresh = fresh;
  return tick;
}

TrialResult report_of(TrialRecorder& recorder) {
  TrialResult result;
  recorder.report(result);
  return result;
}

TEST(TrialRecorder, FillsInWhatTheImagesSay) {
  const NoPolicy policy;
  const TickObserver nobody;
  TrialRecorder recorder(1, policy, nobody);
  const Capture image = detected_image();
  recorder.add(tick_at(0, false), {});
  recorder.add(tick_at(100 * kMs, false), {&image, true, nullptr});
  recorder.add(tick_at(200 * kMs, true), {&image, true, &image});
  recorder.overrun();
  const TrialResult result = report_of(recorder);
  ASSERT_EQ(result.ticks, 3);
  EXPECT_EQ(result.track[0].capture_index, -1);
  EXPECT_EQ(result.track[1].goal_pixels, 60);
  EXPECT_EQ(result.track[1].detections_of_goal, 0) << "not in use yet";
  EXPECT_EQ(result.track[2].capture_index, 4);
  EXPECT_EQ(result.track[2].age_ns, 100 * kMs);
  EXPECT_EQ(result.track[2].detections_of_goal, 1);
  EXPECT_EQ(result.track[2].detections_hash, 77U);
  EXPECT_EQ(result.first_visible_tick, 1);
  EXPECT_EQ(result.first_detected_tick, 2);
  EXPECT_EQ(result.timing.age.values_ns(), std::vector<core::TimeNs>{100 * kMs});
  EXPECT_EQ(result.timing.ticks_without_image, 2);
  EXPECT_EQ(result.timing.ticks_without_news, 2);
  EXPECT_EQ(result.timing.overruns, 1);
}

TEST(TrialRecorder, AGoalThatTheDetectorCannotNameIsNeverDetected) {
  const NoPolicy policy;
  const TickObserver nobody;
  TrialRecorder recorder(-1, policy, nobody);
  Capture image = detected_image();
  image.detections.push_back({-1, 0.5F, {}});
  recorder.add(tick_at(200 * kMs, true), {&image, true, &image});
  EXPECT_EQ(report_of(recorder).first_detected_tick, -1);
}

TEST(TrialRecorder, TheStateHashChainsWhatTheRobotDid) {
  const NoPolicy policy;
  const TickObserver nobody;
  const auto hash_of = [&](double x_m, double forward_mps, core::PolicyMode mode) {
    TrialRecorder recorder(0, policy, nobody);
    TickRecord tick = tick_at(0, true);
    tick.pose.x_m = x_m;
    tick.command.forward_mps = forward_mps;
    tick.mode = mode;
    recorder.add(tick, {});
    recorder.add(tick_at(100 * kMs, true), {});
    const TrialResult result = report_of(recorder);
    EXPECT_NE(result.track[0].state_hash, result.track[1].state_hash);
    EXPECT_EQ(result.state_hash, result.track[1].state_hash);
    return result.state_hash;
  };
  const std::uint64_t hash = hash_of(1.0, 0.5, core::PolicyMode::kExplore);
  EXPECT_EQ(hash_of(1.0, 0.5, core::PolicyMode::kExplore), hash);
  EXPECT_EQ(hash_of(1.0 + 1e-8, 0.5, core::PolicyMode::kExplore), hash)
      << "below a micrometre";
  EXPECT_NE(hash_of(1.0 + 1e-6, 0.5, core::PolicyMode::kExplore), hash);
  EXPECT_NE(hash_of(1.0, 0.500001, core::PolicyMode::kExplore), hash);
  EXPECT_NE(hash_of(1.0, 0.5, core::PolicyMode::kNavigate), hash);
  // Replay logs of earlier versions hold it.
  EXPECT_EQ(hash, 0xb1a1e1e357289f39U);
}

TEST(TrialRecorder, TheObserverIsToldFromTheFirstImageOn) {
  const NoPolicy policy;
  std::vector<std::size_t> detections_told;
  const TickObserver observer = [&](const TickRecord& tick, const core::Frame&,
                                    const std::vector<core::Detection>& detections,
                                    const core::Policy& told) {
    EXPECT_EQ(&told, &policy);
    EXPECT_NE(tick.state_hash, 0U);
    detections_told.push_back(detections.size());
  };
  TrialRecorder recorder(0, policy, observer);
  const Capture image = detected_image();
  recorder.add(tick_at(0, false), {});
  recorder.add(tick_at(100 * kMs, false), {&image, false, nullptr});
  recorder.add(tick_at(200 * kMs, true), {&image, false, &image});
  EXPECT_EQ(detections_told, (std::vector<std::size_t>{0, 2}));
}

}  // namespace
}  // namespace segsim::sim::internal
