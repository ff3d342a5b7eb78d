#pragma once

/// @file
/// What the sensor models do to one view of a scene, side by side, for people: colour, depth
/// and its errors, a lidar scan over the floor plan.

#include <cstdint>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"
#include "core/render.h"
#include "experiments/drawing/floor_plan.h"
#include "sim/ground/world.h"

namespace segsim::experiments::trials {

struct SensorSheetOptions {
  core::Pose2 pose;  ///< Of the robot, world.
  core::CameraIntrinsics camera = core::CameraIntrinsics::from_fov(320, 240, 1.22);
  double camera_height_m = 1.2;
  double turn_radps = 1.0;  ///< That blurs the exposure and smears the scan.
  std::uint64_t seed = 1;
};

/// The free place with the most room around it, looking along +x.
/// @throws core::InputError if there is no room for the robot.
[[nodiscard]] core::Pose2 roomiest_pose(const sim::World& world);

[[nodiscard]] core::Image<core::Rgb8> draw_sensor_sheet(core::Renderer& renderer,
                                                        const sim::World& world,
                                                        const drawing::FloorPlan& plan,
                                                        const SensorSheetOptions& options);

}  // namespace segsim::experiments::trials
