#pragma once

/// @file
/// The robot's camera in the world: what it takes at a pose, and how much of the goal is in
/// it.

#include <cstdint>

#include "core/render.h"
#include "sim/sensors/depth_sensor.h"
#include "sim/trial/goal_objects.h"
#include "sim/trial/trial.h"

namespace segsim::sim::internal {

/// What a judge needs of an image: labels, and the images whose pixels decide about them.
inline constexpr core::Channels kJudgedChannels =
    core::Channels::kRgbd | core::Channels::kLabels;

/// What the true frame says about the goal.
struct GoalView {
  int pixels = 0;            ///< Of all goal instances.
  int largest_instance = 0;  ///< Pixels of the one seen best.
};

/// @param frame  With labels.
[[nodiscard]] GoalView look_for_goal(const core::Frame& frame, const GoalObjects& goal);

class RobotCamera {
 public:
  /// @param options  Outlive it.  @param seed  Of the episode: all noise derives from it.
  RobotCamera(const TrialOptions& options, std::uint64_t seed);

  /// The exact images at that pose of the robot.
  void render(core::Renderer& renderer, const core::Pose2& pose, core::Channels channels,
              core::Frame& frame) const;
  /// From exact depth to what the camera delivers. @param capture  Number of the image.
  void measure(std::uint64_t capture, const core::Image<float>& true_depth_m,
               core::Image<float>& measured_m) const;

  [[nodiscard]] const core::Transform<core::frame::Robot, core::frame::Camera>&
  T_robot_camera() const {
    return T_robot_camera_;
  }

 private:
  const TrialOptions& options_;
  core::Transform<core::frame::Robot, core::frame::Camera> T_robot_camera_;
  DepthModel depth_model_;
  std::uint64_t seed_;
};

}  // namespace segsim::sim::internal
