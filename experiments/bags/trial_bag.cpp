#include "experiments/bags/trial_bag.h"

#include <utility>

#include "experiments/ros2/ros_messages.h"
#include "ros/mcap/topic.h"
#include "ros/messages/rosgraph_msgs.h"
#include "ros/messages/tf2_msgs.h"

namespace segsim::experiments::bags {
namespace {

using ros::mcap::TopicWriter;

/// Histories as the field's drivers have them.
constexpr ros::mcap::OfferedQos kClockQos{.depth = 1};
constexpr ros::mcap::OfferedQos kTransformQos{.depth = 100};
constexpr ros::mcap::OfferedQos kStaticQos{.transient_local = true, .depth = 1};
constexpr ros::mcap::OfferedQos kImageQos{.depth = 5};

}  // namespace

struct TrialBag::Impl {
  Impl(ros::mcap::Writer& to, std::optional<sim::SensorSettings> settings)
      : writer(to), sensors(std::move(settings)) {
    if (!sensors) return;
    if (sensors->lidar) scan.emplace(writer, "/scan");
    if (sensors->imu) imu.emplace(writer, "/imu");
    if (sensors->gps) fix.emplace(writer, "/gps/fix");
  }

  template <class M>
  void put(TopicWriter<M>& topic, core::TimeNs time_ns, const M& message) {
    topic.write(static_cast<std::uint64_t>(time_ns), message);
    ++messages;
  }

  void put_pose(core::TimeNs time_ns, const ros::geometry_msgs::Transform& T_odom_robot) {
    if (time_ns == last_pose_ns) return;  // An image was taken at this tick.
    last_pose_ns = time_ns;
    put(tf, time_ns,
        {{ros2::ros_transform_stamped(time_ns, ros2::kOdomFrame, ros2::kBaseFrame,
                                      T_odom_robot)}});
  }

  ros::mcap::Writer& writer;
  std::optional<sim::SensorSettings> sensors;
  std::vector<std::string> class_names;
  int images = 0, messages = 0;
  core::TimeNs last_pose_ns = -1;
  std::optional<std::pair<core::TimeNs, core::Pose2>> last_estimate;
  ros::sensor_msgs::Image colour_message, depth_message;  ///< They keep their memory.

  TopicWriter<ros::rosgraph_msgs::Clock> clock{writer, "/clock", kClockQos};
  TopicWriter<ros::tf2_msgs::TFMessage> tf{writer, "/tf", kTransformQos};
  TopicWriter<ros::tf2_msgs::TFMessage> tf_static{writer, "/tf_static", kStaticQos};
  TopicWriter<ros::sensor_msgs::Image> colour{writer, "/camera/image_raw", kImageQos};
  TopicWriter<ros::sensor_msgs::Image> depth{writer, "/camera/depth/image_raw", kImageQos};
  TopicWriter<ros::sensor_msgs::CameraInfo> info{writer, "/camera/camera_info", kImageQos};
  TopicWriter<ros::vision_msgs::Detection2DArray> found{writer, "/detections"};
  TopicWriter<ros::nav_msgs::Odometry> odometry{writer, "/odom"};
  TopicWriter<ros::geometry_msgs::Twist> command{writer, "/cmd_vel"};
  std::optional<TopicWriter<ros::sensor_msgs::LaserScan>> scan;
  std::optional<TopicWriter<ros::sensor_msgs::Imu>> imu;
  std::optional<TopicWriter<ros::sensor_msgs::NavSatFix>> fix;
};

TrialBag::TrialBag(ros::mcap::Writer& writer, std::optional<sim::SensorSettings> sensors)
    : impl_(std::make_unique<Impl>(writer, std::move(sensors))) {}

TrialBag::~TrialBag() = default;

int TrialBag::images() const { return impl_->images; }
int TrialBag::messages() const { return impl_->messages; }

void TrialBag::begin(const drawing::TrialScene& /*scene*/,
                     const std::vector<std::string>& detector_classes) {
  impl_->class_names = detector_classes;
}

void TrialBag::observe(const core::Observation& seen,
                       std::span<const core::Detection> detections) {
  Impl& bag = *impl_;
  const core::TimeNs time_ns = seen.capture_time_ns;
  const ros::std_msgs::Header header = ros2::ros_header(time_ns, ros2::kCameraFrame);
  if (bag.images++ == 0) {
    bag.put(bag.tf_static, time_ns,
            ros2::ros_mounts(seen, bag.sensors ? &*bag.sensors : nullptr));
  }
  bag.put_pose(time_ns, ros2::ros_transform(seen.T_odom_robot));
  bag.colour_message.header = bag.depth_message.header = header;
  ros2::to_ros(*seen.rgb, bag.colour_message);
  ros2::to_ros(*seen.depth_m, bag.depth_message);
  bag.put(bag.colour, time_ns, bag.colour_message);
  bag.put(bag.depth, time_ns, bag.depth_message);
  bag.put(bag.info, time_ns, ros2::ros_camera_info(seen.intrinsics, header));
  bag.put(bag.found, time_ns, ros2::ros_detections(detections, bag.class_names, header));
}

void TrialBag::add(const sim::TickRecord& tick, const core::Frame& /*frame*/,
                   std::span<const core::Detection> /*detections*/,
                   const core::PolicyView& /*view*/) {
  Impl& bag = *impl_;
  bag.put(bag.clock, tick.time_ns, {ros2::ros_time(tick.time_ns)});
  const auto T_odom_robot = core::transform_from_pose2<core::frame::Odom>(tick.estimate);
  bag.put_pose(tick.time_ns, ros2::ros_transform(T_odom_robot));
  const auto [before_ns, before] =
      bag.last_estimate.value_or(std::pair(tick.time_ns, tick.estimate));
  bag.put(bag.odometry, tick.time_ns,
          ros2::ros_odometry(tick.time_ns, tick.estimate, before,
                             core::seconds(tick.time_ns - before_ns)));
  bag.put(bag.command, tick.time_ns, ros2::ros_twist(tick.command));
  bag.last_estimate.emplace(tick.time_ns, tick.estimate);
}

void TrialBag::finish(const sim::TrialResult& result) {
  Impl& bag = *impl_;
  if (!bag.sensors) return;
  // Readers sort by time: these come last in the file, and in between when it is read.
  if (bag.scan) {
    for (const auto& reading : result.sensors.lidar) {
      bag.put(*bag.scan, reading.time_ns, ros2::ros_scan(reading, *bag.sensors->lidar));
    }
  }
  if (bag.imu) {
    for (const auto& reading : result.sensors.imu) {
      bag.put(*bag.imu, reading.time_ns, ros2::ros_imu(reading, bag.sensors->imu->model));
    }
  }
  if (bag.fix) {
    for (const auto& reading : result.sensors.gps) {
      bag.put(*bag.fix, reading.time_ns, ros2::ros_fix(reading, bag.sensors->gps->model));
    }
  }
}

}  // namespace segsim::experiments::bags
