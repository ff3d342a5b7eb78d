#include "sim/sensors/sensor_suite.h"

#include <cmath>

#include <gtest/gtest.h>

#include "core/check.h"
#include "sim/ground/robot.h"
#include "tests/sim/rooms.h"

namespace segsim::sim {
namespace {

constexpr core::TimeNs kMs = 1'000'000;
constexpr core::Pose2 kStart{1.0, 1.0, 0.2};
constexpr core::VelocityCommand kVelocity{0.4, 0.5};

core::Pose2 pose_at(core::TimeNs t) { return drive_arc(kStart, kVelocity, core::seconds(t)); }

class Suite : public testing::Test {
 protected:
  /// Drives for some time in steps of that length.
  SensorLog drive(core::TimeNs until_ns, core::TimeNs step_ns = 5 * kMs,
                  std::uint64_t seed = 1) const {
    SensorSuite suite(settings_, mesh_, LocalFrame(origin_), kStart, seed);
    for (core::TimeNs t = step_ns; t <= until_ns; t += step_ns) suite.move_to(t, pose_at(t));
    return suite.take_log();
  }

  SensorSettings settings_;
  TriangleMesh mesh_ = make_room(6.0F, 4.0F);
  core::GeodeticOrigin origin_{49.9, 8.9, 0.0, 0.0};
};

TEST_F(Suite, NothingIsRecordedUnlessAskedFor) {
  const SensorLog log = drive(kMs * 200);
  EXPECT_TRUE(log.digests().empty());
}

TEST_F(Suite, RatePhaseAndLatency) {
  settings_.gps = {{}, 25 * kMs, 0, 60 * kMs};
  settings_.compass = {{}, 40 * kMs, 13 * kMs, 0};
  settings_.imu = {{}, 20 * kMs, 0, 2 * kMs};
  const SensorLog log = drive(100 * kMs);
  ASSERT_EQ(log.gps.size(), 5U) << "0, 25, 50, 75 and 100 ms";
  EXPECT_EQ(log.gps[0].time_ns, 0);
  EXPECT_EQ(log.gps[3].time_ns, 75 * kMs);
  EXPECT_EQ(log.gps[3].available_ns, 135 * kMs);
  ASSERT_EQ(log.compass_rad.size(), 3U) << "13, 53 and 93 ms";
  EXPECT_EQ(log.compass_rad[1].time_ns, 53 * kMs);
  ASSERT_EQ(log.imu.size(), 5U) << "from 20 ms on: at 0 no time has passed";
  EXPECT_EQ(log.imu[0].time_ns, 20 * kMs);
  EXPECT_EQ(log.imu[0].available_ns, 22 * kMs);
}

TEST_F(Suite, ReadingsAreTakenWhereTheRobotWasThen) {
  settings_.compass = {{{}, 0.0}, 7 * kMs, 3 * kMs, 0};
  GpsModel gps;
  gps.horizontal_m = {};
  settings_.gps = {gps, 7 * kMs, 3 * kMs, 0};
  LidarModel lidar;
  lidar.sigma_m = 0.0;
  lidar.forward_m = 0.0;
  lidar.beams = 3;
  settings_.lidar = {lidar, 7 * kMs, 3 * kMs, 0};
  const LocalFrame frame(origin_);
  // No step of 5 ms ends at 3, 17, 24, 31 ms ...
  const SensorLog log = drive(50 * kMs);
  ASSERT_EQ(log.gps.size(), 7U);
  for (std::size_t k = 0; k < log.gps.size(); ++k) {
    const core::Pose2 truth = pose_at(log.gps[k].time_ns);
    const glm::dvec3 found = frame.from_geodetic(log.gps[k].value);
    EXPECT_NEAR(found.x, truth.x_m, 1e-7);
    EXPECT_NEAR(found.y, truth.y_m, 1e-7);
    EXPECT_NEAR(log.compass_rad[k].value, 1.5707963268 - truth.yaw_rad, 1e-9);
    // Beam 1 looks ahead, at the wall x = 6.
    EXPECT_NEAR(log.lidar[k].value[1], (6.0 - truth.x_m) / std::cos(truth.yaw_rad), 1e-5);
  }
}

TEST_F(Suite, ReadingsDoNotDependOnTheSteps) {
  LidarModel lidar;
  lidar.beams = 90;
  lidar.sweep_s = 0.012;
  settings_.lidar = {lidar, 30 * kMs, 0, 0};
  settings_.gps = {{}, 25 * kMs, 0, 0};
  settings_.compass = {{}, 25 * kMs, 0, 0};
  const SensorLog fine = drive(120 * kMs, kMs), coarse = drive(120 * kMs, 6 * kMs);
  ASSERT_EQ(fine.lidar.size(), coarse.lidar.size());
  for (std::size_t k = 0; k < fine.lidar.size(); ++k) {
    for (std::size_t b = 0; b < 90; ++b) {
      EXPECT_NEAR(fine.lidar[k].value[b], coarse.lidar[k].value[b], 1e-5);
    }
  }
  for (std::size_t k = 0; k < fine.gps.size(); ++k) {
    EXPECT_NEAR(fine.gps[k].value.latitude_deg, coarse.gps[k].value.latitude_deg, 1e-12);
    EXPECT_NEAR(fine.compass_rad[k].value, coarse.compass_rad[k].value, 1e-12);
  }
}

TEST_F(Suite, ASweepEndsBeforeItIsThere) {
  LidarModel lidar;
  lidar.beams = 90;
  lidar.sweep_s = 0.018;
  settings_.lidar = {lidar, 25 * kMs, 0, 4 * kMs};
  const SensorLog log = drive(60 * kMs);
  // The one that begins at 50 ms would end at 68 ms.
  ASSERT_EQ(log.lidar.size(), 2U);
  EXPECT_EQ(log.lidar[1].time_ns, 25 * kMs);
  EXPECT_EQ(log.lidar[1].available_ns, 47 * kMs);
}

TEST_F(Suite, OdometryIsThatOfTheOdometer) {
  const OdometryNoise noise = OdometryNoise::skid_steered_indoors();
  settings_.odometry = {noise, 20 * kMs, 0, 0};
  const SensorLog log = drive(400 * kMs, 5 * kMs, 77);
  Odometer odometer(noise, kStart, 77);
  std::size_t k = 0;
  for (core::TimeNs t = 0; t <= 400 * kMs; t += 5 * kMs) {
    if (t > 0) odometer.move_to(t, pose_at(t));
    if (t % (20 * kMs) != 0) continue;
    ASSERT_LT(k, log.odometry.size());
    EXPECT_EQ(log.odometry[k].time_ns, t);
    EXPECT_EQ(log.odometry[k].value.x_m, odometer.estimate().x_m);
    EXPECT_EQ(log.odometry[k].value.yaw_rad, odometer.estimate().yaw_rad);
    ++k;
  }
  EXPECT_EQ(k, log.odometry.size());
}

TEST_F(Suite, DigestsNoticeOneBit) {
  settings_.gps = {{}, 25 * kMs, 0, 0};
  settings_.imu = {{}, 20 * kMs, 0, 0};
  SensorLog a = drive(200 * kMs);
  EXPECT_EQ(a.digests(), drive(200 * kMs).digests());
  EXPECT_NE(a.digests(), drive(200 * kMs, 5 * kMs, 2).digests());
  ASSERT_EQ(a.digests().size(), 2U);
  EXPECT_EQ(a.digests()[0].sensor, "imu");
  const auto before = a.digests();
  a.imu[3].value.gyro_radps.y = std::nextafter(a.imu[3].value.gyro_radps.y, 1.0);
  EXPECT_NE(a.digests()[0].hash, before[0].hash);
  EXPECT_EQ(a.digests()[1], before[1]);
}

TEST_F(Suite, TimesMustMakeSense) {
  settings_.gps = {{}, 0, 0, 0};
  EXPECT_THROW((void)drive(kMs), core::ContractViolation);
  settings_.gps = {{}, 25 * kMs, -1, 0};
  EXPECT_THROW((void)drive(kMs), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::sim
