#pragma once

/// @file
/// One observation with a depth image of its own, for tests of the maps.

#include <cmath>
#include <limits>

#include "core/stages.h"

namespace segsim::nav::test {

inline constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
inline constexpr double kPi = 3.14159265358979323846;

class TestView {
 public:
  /// A level camera at `height_m` above a robot at `pose`, every pixel at `depth_m`.
  explicit TestView(const core::Pose2& pose = {}, float depth_m = 3.0F, double height_m = 0.88,
                    int width_px = 64, int height_px = 48, double hfov_deg = 79.0)
      : depth(width_px, height_px, depth_m) {
    observation.intrinsics =
        core::CameraIntrinsics::from_fov(width_px, height_px, hfov_deg * kPi / 180.0);
    observation.T_robot_camera = core::mast_camera(height_m, 0.0);
    move_to(pose);
    observation.depth_m = &depth;
  }
  TestView(const TestView&) = delete;
  TestView& operator=(const TestView&) = delete;
  void move_to(const core::Pose2& pose) {
    observation.T_odom_robot = core::transform_from_pose2<core::frame::Odom>(pose);
  }

  core::Image<float> depth;
  core::Observation observation;
};

}  // namespace segsim::nav::test
