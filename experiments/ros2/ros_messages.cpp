#include "experiments/ros2/ros_messages.h"

#include <cmath>
#include <cstring>
#include <limits>

#include "core/check.h"

namespace segsim::experiments::ros2 {
namespace {

constexpr double kPixelCentre_px = 0.5;

/// Size and encoding of an image, and room for its pixels.
template <class Pixel>
void describe(int width_px, int height_px, const char* encoding,
              ros::sensor_msgs::Image& message) {
  message.width = static_cast<std::uint32_t>(width_px);
  message.height = static_cast<std::uint32_t>(height_px);
  message.encoding = encoding;
  message.step = message.width * static_cast<std::uint32_t>(sizeof(Pixel));
  message.data.resize(std::size_t{message.step} * message.height);
}

template <class Pixel>
void copy_pixels(const core::Image<Pixel>& image, const char* encoding,
                 ros::sensor_msgs::Image& message) {
  static_assert(sizeof(core::Rgb8) == 3);
  describe<Pixel>(image.width_px(), image.height_px(), encoding, message);
  if (!image.empty()) std::memcpy(message.data.data(), image.data(), message.data.size());
}

/// One value for each pixel of an image. @param value  Of the pixel with this index.
template <class Value, class Pixel, class Of>
void fill_pixels(const core::Image<Pixel>& image, const char* encoding, const Of& value,
                 ros::sensor_msgs::Image& message) {
  describe<Value>(image.width_px(), image.height_px(), encoding, message);
  for (std::size_t i = 0; i < message.data.size() / sizeof(Value); ++i) {
    const Value pixel = value(i);
    std::memcpy(message.data.data() + i * sizeof(Value), &pixel, sizeof(Value));
  }
}

double variance(const sim::ErrorModel& model) {
  return model.sigma * model.sigma + model.drift * model.drift;
}

std::array<double, 9> diagonal(double x, double y, double z) {
  return {x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z};
}

ros::geometry_msgs::Transform shifted(double x_m, double z_m) {
  return {{x_m, 0.0, z_m}, {0.0, 0.0, 0.0, 1.0}};
}

}  // namespace

ros::builtin_interfaces::Time ros_time(core::TimeNs time_ns) {
  SEGSIM_CHECK(time_ns >= 0, std::to_string(time_ns));
  return {static_cast<std::int32_t>(time_ns / core::kNsPerSecond),
          static_cast<std::uint32_t>(time_ns % core::kNsPerSecond)};
}

ros::std_msgs::Header ros_header(core::TimeNs time_ns, const std::string& frame) {
  return {ros_time(time_ns), frame};
}

ros::geometry_msgs::TransformStamped ros_transform_stamped(
    core::TimeNs time_ns, const std::string& frame, const std::string& child,
    const ros::geometry_msgs::Transform& transform) {
  return {ros_header(time_ns, frame), child, transform};
}

ros::tf2_msgs::TFMessage ros_mounts(const core::Observation& seen,
                                    const sim::SensorSettings* sensors) {
  ros::tf2_msgs::TFMessage mounts;
  const auto mount = [&](const char* frame, const ros::geometry_msgs::Transform& transform) {
    mounts.transforms.push_back(
        ros_transform_stamped(seen.capture_time_ns, kBaseFrame, frame, transform));
  };
  mount(kCameraFrame, ros_transform(seen.T_robot_camera));
  if (sensors != nullptr && sensors->lidar) {
    const sim::LidarModel& model = sensors->lidar->model;
    mount(kLaserFrame, shifted(model.forward_m, model.height_m));
  }
  if (sensors != nullptr && sensors->gps) {
    mount(kGpsFrame, shifted(0.0, sensors->gps->model.antenna_m));
  }
  return mounts;
}

void to_ros(const core::Image<core::Rgb8>& image, ros::sensor_msgs::Image& message) {
  copy_pixels(image, "rgb8", message);
}

void to_ros(const core::Image<float>& depth_m, ros::sensor_msgs::Image& message) {
  copy_pixels(depth_m, "32FC1", message);
}

void to_ros_mm(const core::Image<float>& depth_m, ros::sensor_msgs::Image& message) {
  constexpr float kMost_mm = 65535.0F;
  const auto millimetres = [&](std::size_t i) {
    const float mm = std::round(1000.0F * depth_m.data()[i]);
    return static_cast<std::uint16_t>(mm > 0.0F && mm <= kMost_mm ? mm : 0.0F);
  };
  fill_pixels<std::uint16_t>(depth_m, "16UC1", millimetres, message);
}

void labels_to_ros(const core::Frame& frame, ros::sensor_msgs::Image& message) {
  const auto label = [&](std::size_t i) {
    return static_cast<std::int32_t>(frame.semantic.data()[i]) * 65536 +
           static_cast<std::int32_t>(frame.instance.data()[i]);
  };
  fill_pixels<std::int32_t>(frame.semantic, "32SC1", label, message);
}

ros::nav_msgs::OccupancyGrid ros_map(const sim::CollisionWorld& world) {
  const sim::GridMask& occupied = world.body_layer().occupied;
  ros::nav_msgs::OccupancyGrid map;
  map.header.frame_id = kMapFrame;
  map.info.resolution = static_cast<float>(world.frame().cell_m);
  map.info.width = static_cast<std::uint32_t>(occupied.width_px());
  map.info.height = static_cast<std::uint32_t>(occupied.height_px());
  map.info.origin.position = {world.frame().origin_m.x, world.frame().origin_m.y, 0.0};
  map.data.reserve(occupied.size());
  for (const std::uint8_t cell : occupied.pixels()) {
    map.data.push_back(cell != 0 ? std::int8_t{100} : std::int8_t{0});
  }
  return map;
}

ros::sensor_msgs::CameraInfo ros_camera_info(const core::CameraIntrinsics& intrinsics,
                                             const ros::std_msgs::Header& header) {
  ros::sensor_msgs::CameraInfo info;
  info.header = header;
  info.width = static_cast<std::uint32_t>(intrinsics.width_px);
  info.height = static_cast<std::uint32_t>(intrinsics.height_px);
  info.distortion_model = "plumb_bob";
  info.d.assign(5, 0.0);
  const double fx = intrinsics.fx_px, fy = intrinsics.fy_px;
  const double cx = intrinsics.cx_px - kPixelCentre_px;
  const double cy = intrinsics.cy_px - kPixelCentre_px;
  info.k = {fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0};
  info.r = diagonal(1.0, 1.0, 1.0);
  info.p = {fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

ros::vision_msgs::Detection2DArray ros_detections(std::span<const core::Detection> detections,
                                                  const std::vector<std::string>& class_names,
                                                  const ros::std_msgs::Header& header) {
  ros::vision_msgs::Detection2DArray array{header, {}};
  for (const core::Detection& detection : detections) {
    ros::vision_msgs::Detection2D one;
    one.header = header;
    one.results.resize(1);
    one.results[0].hypothesis = {
        class_names.at(static_cast<std::size_t>(detection.class_index)),
        static_cast<double>(detection.score)};
    const core::BoxPx& box = detection.box;
    one.bbox.center.position = {0.5 * (box.x0 + box.x1) - kPixelCentre_px,
                                0.5 * (box.y0 + box.y1) - kPixelCentre_px};
    one.bbox.size_x = box.width_px();
    one.bbox.size_y = box.height_px();
    array.detections.push_back(std::move(one));
  }
  return array;
}

ros::geometry_msgs::Twist ros_twist(const core::VelocityCommand& command) {
  return {{command.forward_mps, 0.0, 0.0}, {0.0, 0.0, command.turn_radps}};
}

ros::nav_msgs::Odometry ros_odometry(core::TimeNs time_ns, const core::Pose2& estimate,
                                     const core::Pose2& before, double elapsed_s) {
  ros::nav_msgs::Odometry odometry;
  odometry.header = ros_header(time_ns, kOdomFrame);
  odometry.child_frame_id = kBaseFrame;
  const double half_rad = 0.5 * estimate.yaw_rad;
  odometry.pose.pose = {{estimate.x_m, estimate.y_m, 0.0},
                        {0.0, 0.0, std::sin(half_rad), std::cos(half_rad)}};
  if (elapsed_s <= 0.0) return odometry;
  // On an arc, the chord has the direction half-way.
  const double turned_rad = core::wrap_angle_rad(estimate.yaw_rad - before.yaw_rad);
  const double heading_rad = before.yaw_rad + 0.5 * turned_rad;
  const double x_m = estimate.x_m - before.x_m, y_m = estimate.y_m - before.y_m;
  const double cosine = std::cos(heading_rad), sine = std::sin(heading_rad);
  odometry.twist.twist.linear = {(cosine * x_m + sine * y_m) / elapsed_s,
                                 (cosine * y_m - sine * x_m) / elapsed_s, 0.0};
  odometry.twist.twist.angular.z = turned_rad / elapsed_s;
  return odometry;
}

ros::sensor_msgs::Imu ros_imu(const sim::Reading<sim::ImuReading>& reading,
                              const sim::ImuModel& model) {
  ros::sensor_msgs::Imu imu;
  imu.header = ros_header(reading.time_ns, kBaseFrame);
  imu.orientation_covariance[0] = -1.0;  // It has no orientation.
  const glm::dvec3& gyro = reading.value.gyro_radps;
  const glm::dvec3& accel = reading.value.accel_mps2;
  imu.angular_velocity = {gyro.x, gyro.y, gyro.z};
  imu.linear_acceleration = {accel.x, accel.y, accel.z};
  const double gyro_variance = variance(model.gyro_radps);
  const double accel_variance = variance(model.accel_mps2);
  imu.angular_velocity_covariance = diagonal(gyro_variance, gyro_variance, gyro_variance);
  imu.linear_acceleration_covariance =
      diagonal(accel_variance, accel_variance, accel_variance);
  return imu;
}

ros::sensor_msgs::LaserScan ros_scan(const sim::Reading<std::vector<float>>& reading,
                                     const sim::Timed<sim::LidarModel>& lidar) {
  const sim::LidarModel& model = lidar.model;
  const double gaps = model.beams - 1;
  ros::sensor_msgs::LaserScan scan;
  scan.header = ros_header(reading.time_ns, kLaserFrame);
  scan.angle_min = static_cast<float>(model.first_rad);
  scan.angle_max = static_cast<float>(model.last_rad);
  scan.angle_increment = static_cast<float>((model.last_rad - model.first_rad) / gaps);
  scan.time_increment = static_cast<float>(model.sweep_s / gaps);
  scan.scan_time = static_cast<float>(core::seconds(lidar.period_ns));
  scan.range_min = static_cast<float>(model.min_range_m);
  scan.range_max = static_cast<float>(model.max_range_m);
  scan.ranges = reading.value;
  for (float& range_m : scan.ranges) {
    if (std::isnan(range_m)) range_m = std::numeric_limits<float>::infinity();
  }
  return scan;
}

ros::sensor_msgs::NavSatFix ros_fix(const sim::Reading<sim::GeodeticPoint>& reading,
                                    const sim::GpsModel& model) {
  ros::sensor_msgs::NavSatFix fix;
  fix.header = ros_header(reading.time_ns, kGpsFrame);
  fix.status = {0, 1};  // A fix, by GPS.
  fix.latitude = reading.value.latitude_deg;
  fix.longitude = reading.value.longitude_deg;
  fix.altitude = reading.value.height_m;
  const double horizontal = variance(model.horizontal_m);
  fix.position_covariance =
      diagonal(horizontal, horizontal, horizontal * model.up_factor * model.up_factor);
  fix.position_covariance_type = 2;  // The diagonal is known.
  return fix;
}

}  // namespace segsim::experiments::ros2
