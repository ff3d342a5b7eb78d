#pragma once

/// @file
/// What the stages exchange, as messages of ROS 2. Frames (REP 105): "odom" is core's Odom,
/// "base_link" its Robot (on the floor, x forward, z up), "camera_optical_frame" its Camera
/// (x right, y down, z forward).
///
/// Centres of pixels are integers there and half integers here, so principal points and
/// centres of boxes are less by 0.5 px (docs/conventions.md).

#include <span>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"
#include "core/render.h"
#include "core/stages.h"
#include "ros/messages/geometry_msgs.h"
#include "ros/messages/nav_msgs.h"
#include "ros/messages/sensor_msgs.h"
#include "ros/messages/tf2_msgs.h"
#include "ros/messages/vision_msgs.h"
#include "sim/ground/collision.h"
#include "sim/sensors/sensor_suite.h"

namespace segsim::experiments::ros2 {

inline constexpr const char* kMapFrame = "map";
inline constexpr const char* kOdomFrame = "odom";
inline constexpr const char* kBaseFrame = "base_link";
inline constexpr const char* kCameraFrame = "camera_optical_frame";
inline constexpr const char* kLaserFrame = "laser";
inline constexpr const char* kGpsFrame = "gps";

/// @param time_ns  Not negative.
[[nodiscard]] ros::builtin_interfaces::Time ros_time(core::TimeNs time_ns);
[[nodiscard]] ros::std_msgs::Header ros_header(core::TimeNs time_ns, const std::string& frame);

template <class To, class From>
[[nodiscard]] ros::geometry_msgs::Transform ros_transform(
    const core::Transform<To, From>& T_to_from) {
  const glm::dvec3& p_m = T_to_from.translation_m();
  const glm::dquat& R = T_to_from.rotation();
  return {{p_m.x, p_m.y, p_m.z}, {R.x, R.y, R.z, R.w}};
}
[[nodiscard]] ros::geometry_msgs::TransformStamped ros_transform_stamped(
    core::TimeNs time_ns, const std::string& frame, const std::string& child,
    const ros::geometry_msgs::Transform& transform);

/// Where camera, lidar and antenna are mounted. @param sensors  Null: a camera alone.
[[nodiscard]] ros::tf2_msgs::TFMessage ros_mounts(const core::Observation& seen,
                                                  const sim::SensorSettings* sensors);

/// "rgb8". `message` keeps its memory.
void to_ros(const core::Image<core::Rgb8>& image, ros::sensor_msgs::Image& message);
/// "32FC1", m along +z; NaN where nothing was measured (REP 118).
void to_ros(const core::Image<float>& depth_m, ros::sensor_msgs::Image& message);
/// "16UC1", mm along +z; 0 where nothing was measured, or beyond 65.535 m (REP 118).
void to_ros_mm(const core::Image<float>& depth_m, ros::sensor_msgs::Image& message);
/// "32SC1", class id * 65536 + instance id; 0 where nothing is.
void labels_to_ros(const core::Frame& frame, ros::sensor_msgs::Image& message);
/// What the robot's base would run into, 100, or not, 0; in the frame "map".
[[nodiscard]] ros::nav_msgs::OccupancyGrid ros_map(const sim::CollisionWorld& world);
[[nodiscard]] ros::sensor_msgs::CameraInfo ros_camera_info(
    const core::CameraIntrinsics& intrinsics, const ros::std_msgs::Header& header);

/// One hypothesis each: `class_id` is the class's name. Their poses are not filled in.
[[nodiscard]] ros::vision_msgs::Detection2DArray ros_detections(
    std::span<const core::Detection> detections, const std::vector<std::string>& class_names,
    const ros::std_msgs::Header& header);

[[nodiscard]] ros::geometry_msgs::Twist ros_twist(const core::VelocityCommand& command);

/// Where the robot believes to be; its velocity is the mean since `before`, `elapsed_s` ago
/// (0: none). Covariances are not filled in.
[[nodiscard]] ros::nav_msgs::Odometry ros_odometry(core::TimeNs time_ns,
                                                   const core::Pose2& estimate,
                                                   const core::Pose2& before,
                                                   double elapsed_s);

// Sensors. Covariances are those of the models' errors.
[[nodiscard]] ros::sensor_msgs::Imu ros_imu(const sim::Reading<sim::ImuReading>& reading,
                                            const sim::ImuModel& model);
/// Beams without a return have range infinity (REP 117).
[[nodiscard]] ros::sensor_msgs::LaserScan ros_scan(
    const sim::Reading<std::vector<float>>& reading, const sim::Timed<sim::LidarModel>& lidar);
[[nodiscard]] ros::sensor_msgs::NavSatFix ros_fix(
    const sim::Reading<sim::GeodeticPoint>& reading, const sim::GpsModel& model);

}  // namespace segsim::experiments::ros2
