#pragma once

/// @file
/// A simulated robot as a node of ROS 2: what its camera and its sensors deliver goes out, and
/// commands come in (docs/ros2.md lists the topics). Nothing of the truth is published unless
/// the settings ask for it. Times are simulated and begin at 0 with every episode.

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/stages.h"
#include "nav/policies/built_in_policies.h"
#include "ros/messages/nav_msgs.h"
#include "ros/messages/sensor_msgs.h"
#include "sim/sensors/sensor_suite.h"

namespace segsim::experiments::ros2 {

/// What somebody on the network wants.
struct RobotOrder {
  core::VelocityCommand command;
  std::optional<core::StopReason> stop{};  ///< The search is over.
};

/// Of all episodes.
struct RobotTraffic {
  std::uint64_t images = 0;      ///< Published, each with all that belongs to it.
  std::uint64_t commands = 0;    ///< Obeyed.
  std::uint64_t superseded = 0;  ///< Commands that a later one replaced before they were read.
  std::uint64_t lost = 0;        ///< Messages that could not be sent.
};

/// What the scene knows of one image.
struct ImageTruth {
  core::TimeNs capture_time_ns = 0;
  ros::sensor_msgs::Image labels;  ///< No header.
  std::vector<core::Detection> boxes;
  std::vector<std::string> class_names;  ///< Of the boxes.
};

class RobotNode {
 public:
  /// @throws core::InputError if the network cannot be joined (ros/dds/transport.h).
  explicit RobotNode(const nav::Ros2Settings& settings);
  ~RobotNode();
  RobotNode(const RobotNode&) = delete;
  RobotNode& operator=(const RobotNode&) = delete;

  /// An episode begins: publishes what to search, and forgets old orders.
  /// @param sensors  What is mounted besides the camera; null: nothing.
  void begin(const core::ObjectGoal& goal, std::vector<std::string> class_names,
             std::shared_ptr<const sim::SensorSettings> sensors);
  /// Publishes the readings that are available by now and were not published yet.
  void publish(const sim::SensorLog& log, core::TimeNs now_ns);
  void publish(const core::Observation& seen, std::span<const core::Detection> detections);
  /// To be published with the image of its time. Older ones are forgotten then.
  void keep(ImageTruth truth);
  /// Latched: for who comes later, too.
  void publish(const ros::nav_msgs::OccupancyGrid& map);

  /// Whether anybody could send commands.
  [[nodiscard]] bool has_pilot() const;
  /// How many have both images.
  [[nodiscard]] int viewers() const;
  /// The newest order that has come; those before it are superseded, but for a stop, which
  /// counts in any case.
  /// @throws core::InputError if it is no velocity.
  [[nodiscard]] std::optional<RobotOrder> take_order();
  /// Forgets velocities that have come; a stop is said once, and counts whenever it comes.
  void drop_velocities();
  /// Until something came, or the wall time is over.
  void wait(double timeout_s);

  [[nodiscard]] const RobotTraffic& traffic() const;
  /// For messages: "ROS 2, domain 7".
  [[nodiscard]] std::string name() const;
  /// "/cmd_vel (geometry_msgs/msg/Twist)"
  [[nodiscard]] std::string command_topic() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::experiments::ros2
