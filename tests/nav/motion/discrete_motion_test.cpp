#include "nav/motion/discrete_motion.h"

#include <gtest/gtest.h>

#include "nav/motion/path_follower.h"
#include "tests/nav/test_view.h"

namespace segsim::nav {
namespace {

using test::kPi;

TEST(DiscreteMotion, TurnsWhileTheTargetIsMoreThan15DegreesOff) {
  const DiscreteMotionOptions options;
  const auto towards = [&](double bearing_deg) {
    const double b = bearing_deg * kPi / 180.0 + 0.4;
    return action_towards({1.0, 2.0, 0.4}, glm::dvec2(1.0 + std::cos(b), 2.0 + std::sin(b)),
                          options);
  };
  EXPECT_EQ(towards(0.0), DiscreteAction::kForward);
  EXPECT_EQ(towards(14.9), DiscreteAction::kForward);
  EXPECT_EQ(towards(-14.9), DiscreteAction::kForward);
  EXPECT_EQ(towards(15.1), DiscreteAction::kTurnLeft);
  EXPECT_EQ(towards(-15.1), DiscreteAction::kTurnRight);
  EXPECT_EQ(towards(179.0), DiscreteAction::kTurnLeft);
}

TEST(DiscreteMotion, ActionsAre25CentimetresAnd30Degrees) {
  const DiscreteMotionOptions options;
  const core::Pose2 from{1.0, 2.0, kPi / 2.0};
  EXPECT_NEAR(after_action(from, DiscreteAction::kForward, options).y_m, 2.25, 1e-12);
  EXPECT_NEAR(after_action(from, DiscreteAction::kTurnLeft, options).yaw_rad, kPi * 2.0 / 3.0,
              1e-8);
  EXPECT_NEAR(after_action(from, DiscreteAction::kTurnRight, options).yaw_rad, kPi / 3.0,
              1e-8);
  EXPECT_NEAR(after_action(from, DiscreteAction::kStop, options).x_m, 1.0, 1e-12);
}

/// Drives one action on an ideal base.
core::Pose2 carry_out(DiscreteAction action, core::Pose2 pose, double period_s, int& ticks) {
  DiscreteExecutor executor;
  core::TimeNs time = 0;
  executor.start(action, pose, time);
  for (ticks = 0; ticks < 100; ++ticks) {
    const core::VelocityCommand command = executor.command(pose, time, period_s);
    if (!executor.busy()) break;
    pose = advance(pose, command, period_s);
    time += static_cast<core::TimeNs>(period_s * 1e9);
  }
  return pose;
}

TEST(DiscreteMotion, TheExecutorArrives) {
  for (const double period_s : {0.05, 0.1, 0.25}) {
    for (const DiscreteAction action :
         {DiscreteAction::kForward, DiscreteAction::kTurnLeft, DiscreteAction::kTurnRight}) {
      const core::Pose2 from{0.3, -0.2, 3.0};
      const core::Pose2 want = after_action(from, action, {});
      int ticks = 0;
      const core::Pose2 to = carry_out(action, from, period_s, ticks);
      EXPECT_NEAR(to.x_m, want.x_m, 0.031);
      EXPECT_NEAR(to.y_m, want.y_m, 0.031);
      EXPECT_NEAR(core::wrap_angle_rad(to.yaw_rad - want.yaw_rad), 0.0, 0.051);
      EXPECT_GT(ticks, 0);
      EXPECT_LT(ticks * period_s, 1.5);
    }
  }
}

TEST(DiscreteMotion, ABlockedActionTimesOut) {
  DiscreteExecutor executor;
  executor.start(DiscreteAction::kForward, {}, 0);
  core::TimeNs time = 0;
  while (executor.busy() && time < 10 * core::kNsPerSecond) {
    (void)executor.command({}, time, 0.1);  // The pose does not change.
    time += core::kNsPerSecond / 10;
  }
  EXPECT_TRUE(executor.timed_out());
  EXPECT_NEAR(core::seconds(time), 2.5, 0.25);
  executor.start(DiscreteAction::kStop, {}, time);
  EXPECT_FALSE(executor.busy());
}

}  // namespace
}  // namespace segsim::nav
