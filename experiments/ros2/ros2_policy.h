#pragma once

/// @file
/// A policy that is whoever answers on a ROS 2 network: each decision publishes what the robot
/// sees (experiments/ros2/robot_node.h) and waits for a command.

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/stages.h"
#include "experiments/ros2/robot_node.h"
#include "experiments/ros2/ros_messages.h"
#include "nav/policies/built_in_policies.h"
#include "sim/sensors/sensor_suite.h"

namespace segsim::experiments::ros2 {

class Ros2Policy final : public core::Policy {
 public:
  Ros2Policy(std::shared_ptr<RobotNode> robot, nav::Ros2Settings settings,
             std::vector<std::string> class_names);

  /// Before the first episode. @param sensors  What is mounted besides the camera.
  void mount(std::shared_ptr<const sim::SensorSettings> sensors) {
    sensors_ = std::move(sensors);
  }
  [[nodiscard]] const nav::Ros2Settings& settings() const { return settings_; }
  /// What a robot does not know, and is asked to publish.
  void show(const sim::CollisionWorld& world) { map_ = ros_map(world); }
  void keep(ImageTruth truth) { robot_->keep(std::move(truth)); }
  /// What the sensors besides the camera have recorded.
  void hear(const sim::SensorLog& log, core::TimeNs now_ns) { robot_->publish(log, now_ns); }

  /// Waits until somebody can send commands.
  /// @throws core::InputError if nobody comes in time; core::Interrupted on a signal.
  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override;
  /// @throws core::InputError if no command comes in time; core::Interrupted on a signal.
  core::Decision decide(const core::Observation& observation,
                        std::span<const core::Detection> detections) override;
  [[nodiscard]] core::PolicyView view() const override { return {}; }

 private:
  [[nodiscard]] RobotOrder await_order(const core::Observation& observation,
                                       std::span<const core::Detection> detections);
  [[nodiscard]] RobotOrder newest_order();

  std::shared_ptr<RobotNode> robot_;
  nav::Ros2Settings settings_;
  std::vector<std::string> class_names_;
  std::shared_ptr<const sim::SensorSettings> sensors_;
  std::optional<ros::nav_msgs::OccupancyGrid> map_;
  RobotOrder order_;  ///< The last one.
  std::int64_t order_wall_ns_ = 0;
  bool answered_ = false;  ///< In this episode.
};

}  // namespace segsim::experiments::ros2
