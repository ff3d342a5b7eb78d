#include "experiments/ros2/robot_node.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <mutex>
#include <set>
#include <utility>

#include "core/error.h"
#include "experiments/ros2/ros_messages.h"
#include "ros/dds/topic_io.h"
#include "ros/messages/rosgraph_msgs.h"
#include "ros/messages/std_msgs.h"

namespace segsim::experiments::ros2 {
namespace {

using ros::dds::TopicReader;
using ros::dds::TopicWriter;

/// As the field's drivers have them.
constexpr ros::dds::Qos kClockQos{.depth = 1};
constexpr ros::dds::Qos kTransformQos{.depth = 100};
constexpr ros::dds::Qos kLatchedQos{.transient_local = true, .depth = 1};
constexpr ros::dds::Qos kImageQos{.depth = 5};
/// Hears reliable writers and others.
constexpr ros::dds::Qos kCommandQos{.reliable = false, .depth = 10};
/// It is said once.
constexpr ros::dds::Qos kStopQos{.depth = 10};

constexpr const char* kCommandTopic = "/cmd_vel";

/// A network has one robot of this process; two would send on the same topics.
class DomainClaim {
 public:
  explicit DomainClaim(int domain) : domain_(domain) {
    const std::lock_guard<std::mutex> lock(mutex());
    if (!claimed().insert(domain).second) {
      throw core::InputError::expected("ROS 2, domain " + std::to_string(domain),
                                       "one robot at a time (--workers 1)", "another");
    }
  }
  ~DomainClaim() {
    const std::lock_guard<std::mutex> lock(mutex());
    claimed().erase(domain_);
  }
  DomainClaim(const DomainClaim&) = delete;
  DomainClaim& operator=(const DomainClaim&) = delete;

 private:
  static std::mutex& mutex() {
    static std::mutex guard;
    return guard;
  }
  static std::set<int>& claimed() {
    static std::set<int> domains;
    return domains;
  }
  int domain_;
};

ros::dds::TransportOptions transport_options(const nav::Ros2Settings& settings) {
  ros::dds::TransportOptions options;
  options.domain = settings.domain;
  options.distro = settings.humble ? ros::dds::Distro::kHumble : ros::dds::Distro::kJazzy;
  options.config = settings.config;
  if (settings.fast_dds) options.implementation = ros::dds::Implementation::kFast;
  return options;
}

using DepthToRos = void(const core::Image<float>&, ros::sensor_msgs::Image&);

template <class M>
using MaybeWriter = std::optional<TopicWriter<M>>;

}  // namespace

struct RobotNode::Impl {
  explicit Impl(const nav::Ros2Settings& settings)
      : claim(settings.domain),
        domain(settings.domain),
        depth_mm(settings.depth_mm),
        transport(ros::dds::open_transport(transport_options(settings))) {
    if (settings.stamped) {
      stamped.emplace(*transport, kCommandTopic, kCommandQos);
    } else {
      plain.emplace(*transport, kCommandTopic, kCommandQos);
    }
    if (settings.truth) {
      labels.emplace(*transport, "/truth/panoptic", kImageQos);
      boxes.emplace(*transport, "/truth/detections");
    }
    if (settings.map) map.emplace(*transport, "/map", kLatchedQos);
  }

  template <class M>
  void put(TopicWriter<M>& topic, const M& message) {
    if (!topic.write(message)) ++traffic.lost;
  }

  void put_pose(const core::Observation& seen) {
    const core::TimeNs time_ns = seen.capture_time_ns;
    put(tf, {{ros_transform_stamped(time_ns, kOdomFrame, kBaseFrame,
                                    ros_transform(seen.T_odom_robot))}});
    const glm::dvec3& p_m = seen.T_odom_robot.translation_m();
    const glm::dquat& R = seen.T_odom_robot.rotation();
    const core::Pose2 estimate{p_m.x, p_m.y, 2.0 * std::atan2(R.z, R.w)};
    const auto [before_ns, before] = last_estimate.value_or(std::pair(time_ns, estimate));
    put(odometry, ros_odometry(time_ns, estimate, before, core::seconds(time_ns - before_ns)));
    last_estimate.emplace(time_ns, estimate);
  }

  /// What the scene knows of the image of that time.
  void put_truth(core::TimeNs time_ns, const ros::std_msgs::Header& header) {
    while (!truths.empty() && truths.front().capture_time_ns < time_ns) truths.pop_front();
    if (truths.empty() || truths.front().capture_time_ns != time_ns) return;
    ImageTruth& truth = truths.front();
    truth.labels.header = header;
    put(*labels, truth.labels);
    put(*boxes, ros_detections(truth.boxes, truth.class_names, header));
  }

  /// Writers of the sensors that are mounted.
  void open_sensors() {
    if (sensors == nullptr) return;
    if (sensors->lidar && !scan) scan.emplace(*transport, "/scan");
    if (sensors->imu && !imu) imu.emplace(*transport, "/imu");
    if (sensors->gps && !fix) fix.emplace(*transport, "/gps/fix");
  }

  /// Of one sensor: readings ascend, and so do the times at which they are there.
  template <class Value, class Put>
  static void put_new(const std::vector<sim::Reading<Value>>& readings, core::TimeNs now_ns,
                      std::size_t& next, const Put& put) {
    while (next < readings.size() && readings[next].available_ns <= now_ns) {
      put(readings[next++]);
    }
  }

  [[nodiscard]] std::optional<ros::geometry_msgs::Twist> next_twist() {
    if (plain) return plain->take();
    const auto message = stamped->take();
    if (!message) return std::nullopt;
    return message->twist;
  }

  DomainClaim claim;
  int domain;
  bool depth_mm;
  std::unique_ptr<ros::dds::Transport> transport;
  RobotTraffic traffic;
  std::vector<std::string> class_names;
  std::shared_ptr<const sim::SensorSettings> sensors;
  std::size_t scans = 0, imu_readings = 0, fixes = 0;  ///< Published of this episode.
  bool mounted = false;                                ///< /tf_static of it, too.
  std::optional<std::pair<core::TimeNs, core::Pose2>> last_estimate;
  std::deque<ImageTruth> truths;  ///< Of images that were not published yet, oldest first.
  ros::sensor_msgs::Image colour_message, depth_message;  ///< They keep their memory.

  TopicWriter<ros::rosgraph_msgs::Clock> clock{*transport, "/clock", kClockQos};
  TopicWriter<ros::tf2_msgs::TFMessage> tf{*transport, "/tf", kTransformQos};
  TopicWriter<ros::tf2_msgs::TFMessage> tf_static{*transport, "/tf_static", kLatchedQos};
  TopicWriter<ros::sensor_msgs::Image> colour{*transport, "/camera/image_raw", kImageQos};
  TopicWriter<ros::sensor_msgs::Image> depth{*transport, "/camera/depth/image_raw", kImageQos};
  TopicWriter<ros::sensor_msgs::CameraInfo> info{*transport, "/camera/camera_info", kImageQos};
  TopicWriter<ros::vision_msgs::Detection2DArray> found{*transport, "/detections"};
  TopicWriter<ros::nav_msgs::Odometry> odometry{*transport, "/odom"};
  TopicWriter<ros::std_msgs::String> goal{*transport, "/goal_object", kLatchedQos};
  MaybeWriter<ros::sensor_msgs::LaserScan> scan;
  MaybeWriter<ros::sensor_msgs::Imu> imu;
  MaybeWriter<ros::sensor_msgs::NavSatFix> fix;
  MaybeWriter<ros::sensor_msgs::Image> labels;  ///< These are asked for.
  MaybeWriter<ros::vision_msgs::Detection2DArray> boxes;
  MaybeWriter<ros::nav_msgs::OccupancyGrid> map;
  std::optional<TopicReader<ros::geometry_msgs::Twist>> plain;  ///< One of these two.
  std::optional<TopicReader<ros::geometry_msgs::TwistStamped>> stamped;
  TopicReader<ros::std_msgs::Bool> stop{*transport, "/stop", kStopQos};
};

RobotNode::RobotNode(const nav::Ros2Settings& settings)
    : impl_(std::make_unique<Impl>(settings)) {}

RobotNode::~RobotNode() = default;

const RobotTraffic& RobotNode::traffic() const { return impl_->traffic; }

std::string RobotNode::name() const {
  return "ROS 2, domain " + std::to_string(impl_->domain);
}

std::string RobotNode::command_topic() const {
  const ros::MessageType type = impl_->plain ? ros::geometry_msgs::Twist::kType
                                             : ros::geometry_msgs::TwistStamped::kType;
  return std::string(kCommandTopic) + " (" + ros::full_name(type) + ")";
}

void RobotNode::begin(const core::ObjectGoal& goal, std::vector<std::string> class_names,
                      std::shared_ptr<const sim::SensorSettings> sensors) {
  Impl& robot = *impl_;
  robot.class_names = std::move(class_names);
  robot.sensors = std::move(sensors);
  robot.open_sensors();
  robot.scans = robot.imu_readings = robot.fixes = 0;
  robot.mounted = false;
  robot.last_estimate.reset();
  robot.truths.clear();
  drop_velocities();
  while (robot.stop.take()) ++robot.traffic.superseded;
  robot.put(robot.goal, {goal.text()});
}

void RobotNode::publish(const sim::SensorLog& log, core::TimeNs now_ns) {
  Impl& robot = *impl_;
  if (robot.scan) {
    Impl::put_new(log.lidar, now_ns, robot.scans, [&](const auto& reading) {
      robot.put(*robot.scan, ros_scan(reading, *robot.sensors->lidar));
    });
  }
  if (robot.imu) {
    Impl::put_new(log.imu, now_ns, robot.imu_readings, [&](const auto& reading) {
      robot.put(*robot.imu, ros_imu(reading, robot.sensors->imu->model));
    });
  }
  if (robot.fix) {
    Impl::put_new(log.gps, now_ns, robot.fixes, [&](const auto& reading) {
      robot.put(*robot.fix, ros_fix(reading, robot.sensors->gps->model));
    });
  }
}

void RobotNode::publish(const core::Observation& seen,
                        std::span<const core::Detection> detections) {
  Impl& robot = *impl_;
  const core::TimeNs time_ns = seen.capture_time_ns;
  const ros::std_msgs::Header header = ros_header(time_ns, kCameraFrame);
  robot.put(robot.clock, {ros_time(time_ns)});
  if (!std::exchange(robot.mounted, true)) {
    ros::tf2_msgs::TFMessage mounts = ros_mounts(seen, robot.sensors.get());
    if (robot.map) {
      mounts.transforms.push_back(ros_transform_stamped(time_ns, kMapFrame, kOdomFrame, {}));
    }
    robot.put(robot.tf_static, mounts);
  }
  robot.put_pose(seen);
  robot.put(robot.info, ros_camera_info(seen.intrinsics, header));
  robot.depth_message.header = robot.colour_message.header = header;
  (robot.depth_mm ? to_ros_mm : static_cast<DepthToRos*>(to_ros))(*seen.depth_m,
                                                                  robot.depth_message);
  robot.put(robot.depth, robot.depth_message);
  robot.put(robot.found, ros_detections(detections, robot.class_names, header));
  if (robot.labels) robot.put_truth(time_ns, header);
  // The last one: who waits for an image has all that belongs to it.
  to_ros(*seen.rgb, robot.colour_message);
  robot.put(robot.colour, robot.colour_message);
  ++robot.traffic.images;
}

void RobotNode::keep(ImageTruth truth) { impl_->truths.push_back(std::move(truth)); }

void RobotNode::publish(const ros::nav_msgs::OccupancyGrid& map) {
  if (impl_->map) impl_->put(*impl_->map, map);
}

bool RobotNode::has_pilot() const {
  const Impl& robot = *impl_;
  return (robot.plain ? robot.plain->writers() : robot.stamped->writers()) > 0;
}

int RobotNode::viewers() const {
  return std::min(impl_->colour.readers(), impl_->depth.readers());
}

std::optional<RobotOrder> RobotNode::take_order() {
  Impl& robot = *impl_;
  std::optional<RobotOrder> order;
  while (const auto twist = robot.next_twist()) {
    const double forward_mps = twist->linear.x, turn_radps = twist->angular.z;
    if (!std::isfinite(forward_mps) || !std::isfinite(turn_radps)) {
      throw core::InputError::expected(
          name() + ", " + command_topic(), "finite velocities",
          std::to_string(forward_mps) + " m/s and " + std::to_string(turn_radps) + " rad/s");
    }
    if (order) ++robot.traffic.superseded;
    order = RobotOrder{{forward_mps, turn_radps}};
  }
  while (const auto over = robot.stop.take()) {
    if (!order) order = RobotOrder{};
    order->stop = over->data ? core::StopReason::kGoalReached : core::StopReason::kNothingNew;
  }
  if (order) ++robot.traffic.commands;
  return order;
}

void RobotNode::drop_velocities() {
  while (impl_->next_twist()) ++impl_->traffic.superseded;
}

void RobotNode::wait(double timeout_s) { (void)impl_->transport->wait(timeout_s); }

}  // namespace segsim::experiments::ros2
