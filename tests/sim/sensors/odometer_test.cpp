#include "sim/sensors/odometer.h"

#include <cmath>

#include <gtest/gtest.h>

#include "sim/ground/robot.h"

namespace segsim::sim {
namespace {

constexpr core::TimeNs kStep_ns = 5'000'000;

/// Drives with constant velocities; what the odometer says in the end.
core::Pose2 drive(const OdometryNoise& noise, const core::VelocityCommand& velocity,
                  double duration_s, std::uint64_t seed, core::Pose2* truth = nullptr) {
  core::Pose2 pose{1.0, 2.0, 0.3};
  Odometer odometer(noise, pose, seed);
  const auto steps = static_cast<int>(std::lround(duration_s / 0.005));
  for (int k = 1; k <= steps; ++k) {
    pose = drive_arc(pose, velocity, 0.005);
    odometer.move_to(k * kStep_ns, pose);
  }
  if (truth != nullptr) *truth = pose;
  return odometer.estimate();
}

TEST(Odometer, WithoutNoiseItKnowsThePose) {
  core::Pose2 truth;
  const core::Pose2 found = drive({}, {0.7, 0.9}, 7.303, 1, &truth);
  EXPECT_NEAR(found.x_m, truth.x_m, 1e-9);
  EXPECT_NEAR(found.y_m, truth.y_m, 1e-9);
  EXPECT_NEAR(core::wrap_angle_rad(found.yaw_rad - truth.yaw_rad), 0.0, 1e-9);
}

TEST(Odometer, ErrorsGrowAsTheirVariancesSay) {
  OdometryNoise noise;
  noise.trans_per_m = 4e-4;
  noise.rot_per_m = 1e-6;  // Small, so that the length stays along the line.
  constexpr int kRuns = 400;
  double along2 = 0.0, turn2 = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    core::Pose2 truth;
    const core::Pose2 found =
        drive(noise, {1.0, 0.0}, 9.0, static_cast<std::uint64_t>(run), &truth);
    const double dx = found.x_m - truth.x_m, dy = found.y_m - truth.y_m;
    const double along = std::cos(0.3) * dx + std::sin(0.3) * dy;
    along2 += along * along / kRuns;
    turn2 += std::pow(core::wrap_angle_rad(found.yaw_rad - truth.yaw_rad), 2) / kRuns;
  }
  // 9 m. The standard error of a variance of 400 runs is 7 %.
  EXPECT_NEAR(along2, 9.0 * 4e-4, 0.25 * 9.0 * 4e-4);
  EXPECT_NEAR(turn2, 9.0 * 1e-6, 0.25 * 9.0 * 1e-6);
}

TEST(Odometer, SlipIsABias) {
  OdometryNoise noise;
  noise.forward_slip = 0.1;
  const core::Pose2 found = drive(noise, {1.0, 0.0}, 9.0, 1);
  EXPECT_NEAR(std::hypot(found.x_m - 1.0, found.y_m - 2.0), 10.0, 0.01);
  noise = {};
  noise.turn_slip = 0.5;
  EXPECT_NEAR(drive(noise, {0.0, 0.5}, 1.0, 1).yaw_rad, 0.3 + 1.0, 1e-9);
}

TEST(Odometer, ARobotThatStandsDoesNotDrift) {
  const core::Pose2 found = drive(OdometryNoise::skid_steered_indoors(), {0.0, 0.0}, 60.0, 1);
  EXPECT_NEAR(found.x_m, 1.0, 1e-12);
  EXPECT_NEAR(found.yaw_rad, 0.3, 1e-12);
}

TEST(Odometer, TheEpisodeDecidesTheNoise) {
  const OdometryNoise noise = OdometryNoise::skid_steered_indoors();
  const core::Pose2 a = drive(noise, {0.5, 0.2}, 3.0, 7), b = drive(noise, {0.5, 0.2}, 3.0, 7);
  EXPECT_EQ(a.x_m, b.x_m);
  EXPECT_EQ(a.yaw_rad, b.yaw_rad);
  EXPECT_NE(drive(noise, {0.5, 0.2}, 3.0, 8).x_m, a.x_m);
}

}  // namespace
}  // namespace segsim::sim
