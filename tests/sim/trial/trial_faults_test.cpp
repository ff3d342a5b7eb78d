// Slower stages, missing images, slow cameras.
#include <gtest/gtest.h>

#include "tests/sim/trial/timed_trial.h"

namespace segsim::sim {
namespace {

using TrialFaultsTest = TimedTrialTest;

TEST_F(TrialFaultsTest, AStageIsSlowerWhileAFaultLasts) {
  play(0, 30, 0, 0);
  options_.control_period_s = 0.05;
  options_.time_limit_s = 4.0;
  options_.faults.latencies = {{"detect", 1000 * kMs, 2000 * kMs, 200 * kMs}};
  const TrialResult result = run(weave);
  for (const TickRecord& tick : result.track) {
    const core::TimeNs t = tick.time_ns / kMs;
    if (t >= 100 && t <= 1000) {
      ASSERT_EQ(tick.age_ns, 50 * kMs) << t << " ms";
    }
    if (t >= 1300 && t < 2200) {
      ASSERT_GE(tick.age_ns, 250 * kMs) << t << " ms";
    }
    if (t >= 2400) {
      ASSERT_EQ(tick.age_ns, 50 * kMs) << t << " ms";
    }
  }
  EXPECT_GE(result.timing.find("detect")->response.max(), 230 * kMs) << "images wait, too";
}

TEST_F(TrialFaultsTest, DroppedFramesAreMissingAndShiftNoOther) {
  options_.time_limit_s = 3.0;
  options_.clock.camera = {100 * kMs, 0, 20 * kMs};
  play(0, 0, 0, 0);
  const TrialResult whole = run(weave);
  options_.faults.frame_drops = {{1000 * kMs, 6}};
  const TrialResult result = run(weave);
  EXPECT_EQ(result.frames_dropped, 6);
  EXPECT_EQ(result.timing.age.max() / (100 * kMs), 6);
  ASSERT_EQ(result.track.size(), whole.track.size());
  // The camera's jitter is keyed by the image's number, so later images are those of before.
  EXPECT_EQ(result.track.back().capture_index, whole.track.back().capture_index);
  EXPECT_EQ(result.track.back().age_ns, whole.track.back().age_ns);
}

TEST_F(TrialFaultsTest, ASlowCameraIsAskedOnlyWhenItSamples) {
  options_.clock.camera = {300 * kMs, 0, 0};
  options_.time_limit_s = 3.0;
  NotingPolicy policy(weave);
  const TrialResult result = run(policy);
  EXPECT_EQ(policy.poses_.size(), 11U) << "0, 0.3, ..., 3.0 s";
  EXPECT_EQ(result.ticks, 31);
  EXPECT_EQ(result.timing.ticks_without_news, 20);
  EXPECT_GT(result.path_m, 0.5) << "between images the last command holds";
}

}  // namespace
}  // namespace segsim::sim
