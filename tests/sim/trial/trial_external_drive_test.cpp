// Trials whose robot another simulator moves.
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "core/error.h"
#include "tests/sim/trial/timed_trial.h"

namespace segsim::sim {
namespace {

/// Obeys at once, in steps of 10 ms of a clock that begins elsewhere; or through walls.
class ObedientDrive final : public ExternalDrive {
 public:
  core::Pose2 begin(const core::Pose2& start) override {
    ++begun_;
    pose_ = start;
    pose_.x_m += 0.02;  // It was set down a little beside.
    time_ns_ = -1;
    return pose_;
  }
  void command(const core::VelocityCommand& command) override {
    commands_.push_back(command);
    command_ = command;
  }
  Moment next(core::TimeNs until_ns) override {
    if (time_ns_ < 0) return {time_ns_ = 0, pose_};
    if (time_ns_ >= fails_ns_) {
      throw core::InputError::expected("the other simulator", "a pose", "none");
    }
    const core::TimeNs next_ns = std::min(until_ns, time_ns_ + 10 * kMs);
    pose_ = drive_arc(pose_, command_, core::seconds(next_ns - time_ns_));
    return {time_ns_ = next_ns, pose_};
  }

  void end() noexcept override { ++ended_; }

  int begun_ = 0, ended_ = 0;
  std::vector<core::VelocityCommand> commands_;
  core::TimeNs fails_ns_ = 1'000'000 * kMs;

 private:
  core::Pose2 pose_;
  core::VelocityCommand command_;
  core::TimeNs time_ns_ = -1;
};

class ExternalDriveTest : public TimedTrialTest {
 protected:
  ExternalDriveTest() {
    drive_ = &other_;
    options_.clock.mode = ClockMode::kRealtime;
    options_.time_limit_s = 3.0;
  }
  ObedientDrive other_;
};

TEST_F(ExternalDriveTest, TheRobotIsWhereTheOtherSimulatorSays) {
  const TrialResult result = run([](const core::Observation&) { return command(0.5, 0.0); });
  EXPECT_EQ(other_.begun_, 1);
  EXPECT_EQ(other_.ended_, 1);
  EXPECT_EQ(result.outcome, Outcome::kTimeout);
  EXPECT_NEAR(result.track.front().pose.x_m, episode_.start.x_m + 0.02, 1e-12);
  // Without this program's limits of acceleration: half a metre a second from the first
  // decision, which took some milliseconds, to the end.
  EXPECT_GT(result.path_m, 1.2);
  EXPECT_LE(result.path_m, 1.5 + 1e-9);
  EXPECT_NEAR(std::hypot(result.final_pose.x_m - result.track.front().pose.x_m,
                         result.final_pose.y_m - result.track.front().pose.y_m),
              result.path_m, 1e-9);
  EXPECT_EQ(result.contacts, 0);
  // The base of the other simulator is told at every tick, as ours is.
  EXPECT_GE(other_.commands_.size(), result.track.size() - 2);
}

TEST_F(ExternalDriveTest, WhatItTouchesIsAContactButStopsNothing) {
  episode_.start = {18.9, 15.0, 0.0};  // A metre before the wall at 20 m.
  const TrialResult result = run([](const core::Observation&) { return command(0.5, 0.0); });
  EXPECT_EQ(result.contacts, 1);
  EXPECT_GT(result.contact_s, 0.1);
  EXPECT_GT(result.final_pose.x_m, 20.0) << "this simulator stopped it";
  ASSERT_EQ(result.contact_log.size(), 1U);
  EXPECT_NEAR(result.contact_log[0].approach_mps, 0.5, 0.02);
  EXPECT_NEAR(result.contact_log[0].point_m.x, 20.0, 0.05);

  options_.stop_on_contact = true;
  EXPECT_EQ(run([](const core::Observation&) { return command(0.5, 0.0); }).outcome,
            Outcome::kCollision);
}

TEST_F(ExternalDriveTest, ItsFailureIsTheTrials) {
  other_.fails_ns_ = 500 * kMs;
  EXPECT_THROW(run([](const core::Observation&) { return command(0.5, 0.0); }),
               core::InputError);
  EXPECT_EQ(other_.ended_, 1) << "the robot would drive on";
}

TEST_F(ExternalDriveTest, ItCannotWaitForUs) {
  options_.clock.mode = ClockMode::kLockstep;
  EXPECT_ANY_THROW(run([](const core::Observation&) { return command(0.5, 0.0); }));
}

}  // namespace
}  // namespace segsim::sim
