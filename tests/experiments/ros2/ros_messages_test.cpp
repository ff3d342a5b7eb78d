#include "experiments/ros2/ros_messages.h"

#include <cmath>
#include <limits>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"

namespace segsim::experiments::ros2 {
namespace {

TEST(RosMessages, TimesAreSecondsAndNanoseconds) {
  EXPECT_EQ(ros_time(3'250'000'001), (ros::builtin_interfaces::Time{3, 250'000'001}));
  EXPECT_THROW((void)ros_time(-1), core::ContractViolation);
}

TEST(RosMessages, PixelsAreCopiedRowByRow) {
  core::Image<core::Rgb8> image(2, 2);
  image(1, 0) = {1, 2, 3};
  image(0, 1) = {4, 5, 6};
  ros::sensor_msgs::Image message;
  to_ros(image, message);
  EXPECT_EQ(message.encoding, "rgb8");
  EXPECT_EQ(message.step, 6U);
  EXPECT_THAT(message.data, testing::ElementsAre(0, 0, 0, 1, 2, 3, 4, 5, 6, 0, 0, 0));

  const core::Image<float> depth_m(3, 1, 1.0F);
  to_ros(depth_m, message);
  EXPECT_EQ(message.encoding, "32FC1");
  EXPECT_EQ(message.step, 12U);
  EXPECT_THAT(message.data,
              testing::ElementsAre(0, 0, 0x80, 0x3f, 0, 0, 0x80, 0x3f, 0, 0, 0x80,
                                   0x3f));  // IEEE 754.
}

TEST(RosMessages, MillimetresAreWholeAndZeroWhereNothingWasMeasured) {
  core::Image<float> depth_m(6, 1, std::numeric_limits<float>::quiet_NaN());
  depth_m(1, 0) = 1.2344F;
  depth_m(2, 0) = 65.535F;
  depth_m(3, 0) = 65.536F;
  depth_m(4, 0) = -1.0F;
  depth_m(5, 0) = std::numeric_limits<float>::infinity();
  ros::sensor_msgs::Image message;
  to_ros_mm(depth_m, message);
  EXPECT_EQ(message.encoding, "16UC1");
  EXPECT_EQ(message.step, 12U);
  EXPECT_THAT(message.data,
              testing::ElementsAre(0, 0, 0xd2, 0x04, 0xff, 0xff, 0, 0, 0, 0, 0, 0));
}

/// A camera with its principal point in the middle of 4 pixels looks at the corner that the
/// middle two share; where centres are 0, 1, 2, 3, that is at 1.5.
TEST(RosMessages, PrincipalPointsCountFromThePixelsCentre) {
  const auto info = ros_camera_info({4, 2, 100.0, 101.0, 2.0, 1.0}, {});
  EXPECT_THAT(info.k, testing::ElementsAre(100.0, 0.0, 1.5, 0.0, 101.0, 0.5, 0.0, 0.0, 1.0));
  EXPECT_THAT(info.p, testing::ElementsAre(100.0, 0.0, 1.5, 0.0, 0.0, 101.0, 0.5, 0.0, 0.0,
                                           0.0, 1.0, 0.0));
  EXPECT_THAT(info.d, testing::Each(0.0));
}

TEST(RosMessages, BoxesCountFromThePixelsCentre) {
  // Pixels 2, 3 and 4, whose middle is 3.
  const core::Detection detection{1, 0.5F, {2.0F, 0.0F, 5.0F, 1.0F}};
  const auto array = ros_detections({&detection, 1}, {"couch", "chair"}, {{1, 0}, "camera"});
  ASSERT_EQ(array.detections.size(), 1U);
  const auto& found = array.detections[0];
  EXPECT_EQ(found.header, array.header);
  EXPECT_EQ(found.results.at(0).hypothesis,
            (ros::vision_msgs::ObjectHypothesis{"chair", 0.5}));
  EXPECT_EQ(found.bbox.center.position, (ros::vision_msgs::Point2D{3.0, 0.0}));
  EXPECT_EQ(found.bbox.size_x, 3.0);
  EXPECT_EQ(found.bbox.size_y, 1.0);
}

TEST(RosMessages, AnArcHasTheVelocityThatItWasDrivenWith) {
  // A quarter of a circle of radius 2 m to the left, in small steps.
  constexpr double kStep_s = 0.01, kTurn_radps = 0.5;
  const auto at = [](double yaw_rad) {
    return core::Pose2{2.0 * std::sin(yaw_rad), 2.0 - 2.0 * std::cos(yaw_rad), yaw_rad};
  };
  for (double yaw_rad = 0.0; yaw_rad < 7.0; yaw_rad += kStep_s * kTurn_radps) {
    core::Pose2 now = at(yaw_rad + kStep_s * kTurn_radps), before = at(yaw_rad);
    now.yaw_rad = core::wrap_angle_rad(now.yaw_rad);
    before.yaw_rad = core::wrap_angle_rad(before.yaw_rad);
    const auto twist = ros_odometry(0, now, before, kStep_s).twist.twist;
    EXPECT_NEAR(twist.linear.x, 2.0 * kTurn_radps, 1e-4);
    EXPECT_NEAR(twist.linear.y, 0.0, 1e-9);
    EXPECT_NEAR(twist.angular.z, kTurn_radps, 1e-9);
  }
}

TEST(RosMessages, OdometryIsThePoseInOdom) {
  const auto odometry = ros_odometry(0, {1.0, 2.0, std::numbers::pi / 2.0}, {}, 0.0);
  EXPECT_EQ(odometry.header.frame_id, "odom");
  EXPECT_EQ(odometry.child_frame_id, "base_link");
  EXPECT_EQ(odometry.pose.pose.position, (ros::geometry_msgs::Point{1.0, 2.0, 0.0}));
  EXPECT_NEAR(odometry.pose.pose.orientation.z, std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(odometry.pose.pose.orientation.w, std::sqrt(0.5), 1e-12);
  EXPECT_EQ(odometry.twist.twist, ros::geometry_msgs::Twist{});
}

TEST(RosMessages, TransformsKeepTheirDirection) {
  const auto T_robot_camera = core::mast_camera(1.2, 0.0, 0.1);
  const auto transform = ros_transform(T_robot_camera);
  EXPECT_NEAR(transform.translation.z, 1.2, 1e-12);
  // tf2 applies it as q v q* + t: the camera's +z is the robot's +x.
  const glm::dquat R(transform.rotation.w, transform.rotation.x, transform.rotation.y,
                     transform.rotation.z);
  EXPECT_NEAR((R * glm::dvec3(0.0, 0.0, 1.0)).x, 1.0, 1e-12);
}

TEST(RosMessages, BeamsWithoutAReturnAreInfinite) {
  sim::Timed<sim::LidarModel> lidar;
  lidar.model.beams = 3;
  lidar.model.sweep_s = 0.02;
  lidar.period_ns = 100'000'000;
  const auto scan =
      ros_scan({0, 0, {1.0F, std::numeric_limits<float>::quiet_NaN(), 2.0F}}, lidar);
  EXPECT_THAT(scan.ranges,
              testing::ElementsAre(1.0F, std::numeric_limits<float>::infinity(), 2.0F));
  EXPECT_FLOAT_EQ(scan.angle_increment, 2.35619F);
  EXPECT_FLOAT_EQ(scan.time_increment, 0.01F);
  EXPECT_FLOAT_EQ(scan.scan_time, 0.1F);
}

TEST(RosMessages, AnImuSaysThatItHasNoOrientation) {
  const auto imu =
      ros_imu({5, 5, {{0.0, 0.0, 9.8}, {0.0, 0.0, 0.1}}}, {{0.3, 0.4}, {0.0, 0.1}});
  EXPECT_EQ(imu.orientation_covariance[0], -1.0);
  EXPECT_EQ(imu.linear_acceleration.z, 9.8);
  EXPECT_NEAR(imu.linear_acceleration_covariance[8], 0.25, 1e-12);
  EXPECT_NEAR(imu.angular_velocity_covariance[4], 0.01, 1e-12);
}

}  // namespace
}  // namespace segsim::experiments::ros2
