#include "sim/sensors/imu.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "core/check.h"
#include "sim/ground/robot.h"

namespace segsim::sim {
namespace {

constexpr core::TimeNs kStep_ns = 5'000'000, kPeriod_ns = 20'000'000;
const ImuModel kExact{{}, {}};

TEST(Imu, AtRestItFeelsGravityAlone) {
  Imu imu(kExact, {1.0, 2.0, 0.7}, 1);
  imu.move_to(kPeriod_ns, {1.0, 2.0, 0.7});
  const ImuReading reading = imu.read();
  EXPECT_EQ(reading.accel_mps2, glm::dvec3(0.0, 0.0, 9.80665));
  EXPECT_EQ(reading.gyro_radps, glm::dvec3(0.0));
}

TEST(Imu, ACircleIsACentripetalAcceleration) {
  core::Pose2 pose{0.0, 0.0, 0.3};
  Imu imu(kExact, pose, 1);
  ImuReading reading;
  for (int k = 1; k <= 40; ++k) {
    pose = drive_arc(pose, {0.5, 1.2}, 0.005);
    imu.move_to(k * kStep_ns, pose);
    if (k % 4 == 0) reading = imu.read();
  }
  // v w = 0.6 m/s^2 to the left. Chords of steps instead of tangents: 2 mm/s^2.
  EXPECT_NEAR(reading.accel_mps2.x, 0.0, 0.002);
  EXPECT_NEAR(reading.accel_mps2.y, 0.6, 0.001);
  EXPECT_NEAR(reading.gyro_radps.z, 1.2, 1e-9);
}

TEST(Imu, SpeedingUpIsFeltAlongX) {
  core::Pose2 pose{0.0, 0.0, 2.0};
  Imu imu(kExact, pose, 1);
  double v = 0.0;
  for (int k = 1; k <= 40; ++k) {
    v += 1.5 * 0.005;
    pose = drive_arc(pose, {v, 0.0}, 0.005);
    imu.move_to(k * kStep_ns, pose);
    if (k % 4 != 0) continue;
    const ImuReading reading = imu.read();
    EXPECT_NEAR(reading.accel_mps2.x, 1.5, 1e-9);
    EXPECT_NEAR(reading.accel_mps2.y, 0.0, 1e-9);
  }
}

TEST(Imu, NoiselessReadingsAddUpToTheDrivenPath) {
  Robot robot(RobotModel::jackal_gentle(), {1.0, -2.0, 0.4});
  const core::Pose2 start = robot.state().pose;
  Imu imu(kExact, start, 1);
  double yaw = start.yaw_rad, path_m = 0.0, worst_m = 0.0;
  glm::dvec2 v(0.0), p(start.x_m, start.y_m);
  const double h = core::seconds(kPeriod_ns);
  for (int k = 1; k <= 6000; ++k) {  // 30 s
    const double t = k * 0.005;
    const glm::dvec2 before(robot.state().pose.x_m, robot.state().pose.y_m);
    robot.step({0.5 + 0.3 * std::sin(0.7 * t), 0.8 * std::sin(0.9 * t)}, 0.005);
    const core::Pose2& pose = robot.state().pose;
    path_m += std::hypot(pose.x_m - before.x, pose.y_m - before.y);
    imu.move_to(k * kStep_ns, pose);
    if (k % 4 != 0) continue;
    const ImuReading reading = imu.read();
    const double middle = yaw + 0.5 * h * reading.gyro_radps.z;
    yaw += h * reading.gyro_radps.z;
    const glm::dvec2 a(reading.accel_mps2.x, reading.accel_mps2.y);
    const glm::dvec2 old = v;
    v += h * glm::dvec2(std::cos(middle) * a.x - std::sin(middle) * a.y,
                        std::sin(middle) * a.x + std::cos(middle) * a.y);
    p += 0.5 * h * (old + v);
    worst_m = std::max(worst_m, std::hypot(p.x - pose.x_m, p.y - pose.y_m));
    EXPECT_NEAR(core::wrap_angle_rad(yaw - pose.yaw_rad), 0.0, 1e-9);
  }
  EXPECT_GT(path_m, 10.0);
  // Velocities are those of the last step, half of it (2.5 ms) late: 2 mm at 0.8 m/s.
  EXPECT_LT(worst_m, 0.005);
}

TEST(Imu, EveryAxisHasItsNoise) {
  ImuModel model;
  model.accel_mps2 = {0.02, 0.0, 100.0};
  model.gyro_radps = {0.003, 0.0, 100.0};
  Imu imu(model, {}, 9);
  glm::dvec3 accel2(0.0), gyro2(0.0);
  double crossed = 0.0;
  constexpr int kReadings = 8000;
  for (int k = 1; k <= kReadings; ++k) {
    imu.move_to(k * kPeriod_ns, {});
    const ImuReading r = imu.read();
    const glm::dvec3 a = r.accel_mps2 - glm::dvec3(0.0, 0.0, kGravity_mps2);
    accel2 += a * a / static_cast<double>(kReadings);
    gyro2 += r.gyro_radps * r.gyro_radps / static_cast<double>(kReadings);
    crossed += a.x * a.y / kReadings;
  }
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(std::sqrt(accel2[axis]), 0.02, 0.0008) << axis;
    EXPECT_NEAR(std::sqrt(gyro2[axis]), 0.003, 0.00012) << axis;
  }
  EXPECT_NEAR(crossed, 0.0, 4.0 * 0.02 * 0.02 / std::sqrt(kReadings));
}

TEST(Imu, AReadingCoversTime) {
  Imu imu(kExact, {}, 1);
  EXPECT_THROW((void)imu.read(), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::sim
