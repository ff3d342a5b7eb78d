#pragma once

/// @file
/// A trial as ROS 2 messages in an MCAP file: what the robot's own computer knows, and nothing
/// of the truth (docs/ros2.md lists the topics). Times are simulated and count from the start
/// of the episode; a message is logged at the time in its stamp.

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "experiments/trials/trial_viewer.h"
#include "ros/mcap/mcap_writer.h"
#include "sim/sensors/sensor_suite.h"

namespace segsim::experiments::bags {

class TrialBag final : public trials::TrialViewer {
 public:
  /// @param writer  Must outlive the bag; who made it closes it.
  /// @param sensors  Of the spec: what is mounted besides the camera.
  TrialBag(ros::mcap::Writer& writer, std::optional<sim::SensorSettings> sensors);
  ~TrialBag() override;

  void begin(const drawing::TrialScene& scene,
             const std::vector<std::string>& detector_classes) override;
  void observe(const core::Observation& seen,
               std::span<const core::Detection> detections) override;
  void add(const sim::TickRecord& tick, const core::Frame& frame,
           std::span<const core::Detection> detections, const core::PolicyView& view) override;
  void finish(const sim::TrialResult& result) override;

  [[nodiscard]] int images() const;
  [[nodiscard]] int messages() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::experiments::bags
