#pragma once

/// @file
/// Between the transport's thread and a trial: where one model of Gazebo was, and when.

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <span>
#include <string>

#include "core/frames.h"
#include "core/stages.h"
#include "sim/gazebo/gazebo_pose.h"

namespace segsim::sim::internal {

/// A model at a moment of Gazebo's clock.
struct ModelPose {
  core::TimeNs stamp_ns = 0;
  core::Pose2 pose;
  double height_m = 0.0;  ///< Of the model's origin.
  double upright = 1.0;   ///< Cosine of its tilt.
};

/// Between two poses at a time that lies between their stamps.
[[nodiscard]] core::Pose2 pose_between(const ModelPose& a, const ModelPose& b,
                                       core::TimeNs stamp_ns);

class ModelTrack {
 public:
  explicit ModelTrack(const std::string& model);

  /// One message, from any thread. Poses of a time that was there already are forgotten; a
  /// clock that went back begins a new track.
  void put(std::optional<core::TimeNs> stamp_ns, std::span<const GazeboEntity> entities);
  void put_unreadable();

  /// The newest pose, if one came after `after_ns` or before a clock went back.
  /// @param patience  How long it may take.
  [[nodiscard]] std::optional<ModelPose> wait_newer(core::TimeNs after_ns,
                                                    std::chrono::milliseconds patience);
  /// The oldest pose that was not taken yet and lies after `after_ns`.
  [[nodiscard]] std::optional<ModelPose> take(core::TimeNs after_ns,
                                              std::chrono::milliseconds patience);
  [[nodiscard]] std::optional<ModelPose> newest() const;
  /// How often the clock went back.
  [[nodiscard]] std::uint64_t restarts() const;
  /// What was wrong with the last message that gave no pose; empty: none was.
  [[nodiscard]] std::string last_fault() const;

 private:
  /// Messages that nobody takes: ten minutes at 120 Hz.
  static constexpr std::size_t kMost = 72'000;

  GazeboCamera model_;  ///< Its link path is the model, so that camera_pose() finds it.
  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::deque<ModelPose> waiting_;  ///< Oldest first.
  std::optional<ModelPose> newest_;
  std::uint64_t restarts_ = 0;
  std::string last_fault_;
};

}  // namespace segsim::sim::internal
