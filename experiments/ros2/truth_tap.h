#pragma once

/// @file
/// Between a trial and its detector, where a robot on a ROS 2 network is asked to publish what
/// the scene knows: labels and boxes of every image.

#include <vector>

#include "core/scene_bundle.h"
#include "experiments/ros2/ros2_policy.h"
#include "sim/trial/oracle_detector.h"
#include "sim/trial/thing_names.h"

namespace segsim::experiments::ros2 {

class TruthTap final : public core::Detector, public sim::GroundTruthSink {
 public:
  /// All outlive it.
  /// @param inner_truth  Of the inner detector. @param min_pixels  Of a box.
  TruthTap(core::Detector& inner, sim::GroundTruthSink& inner_truth, Ros2Policy& robot,
           const std::vector<core::SceneClass>& classes, int min_pixels)
      : inner_(inner),
        inner_truth_(inner_truth),
        robot_(robot),
        oracle_(classes, sim::thing_names(classes), {.min_pixels = min_pixels}) {}

  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return inner_.class_names();
  }
  void begin_episode(const sim::Episode& episode) override {
    inner_truth_.begin_episode(episode);
  }
  void set_truth(const core::Frame& frame) override {
    oracle_.set_truth(frame);
    labels_to_ros(frame, labels_);
    inner_truth_.set_truth(frame);
  }
  [[nodiscard]] std::vector<core::Detection> detect(const core::Observation& seen) override {
    robot_.keep({seen.capture_time_ns, labels_, oracle_.detect(seen), oracle_.class_names()});
    return inner_.detect(seen);
  }

 private:
  core::Detector& inner_;
  sim::GroundTruthSink& inner_truth_;
  Ros2Policy& robot_;
  sim::OracleDetector oracle_;
  ros::sensor_msgs::Image labels_;  ///< Of the image that detect() is called for next.
};

}  // namespace segsim::experiments::ros2
