#pragma once

/// @file
/// What a reconstruction looks like from where the robot is and no training camera was: a
/// contact sheet, two heights side by side, to see what breaks there.

#include <cstdint>
#include <span>

#include <glm/vec3.hpp>

#include "core/image.h"
#include "core/render.h"
#include "sim/ground/world.h"

namespace segsim::experiments::scenes {

struct RobotPictureOptions {
  double mast_height_m = 1.2;  ///< Of the camera in the left column.
  double deck_height_m = 0.4;  ///< Right column: a camera on the robot's own deck.
  int places = 6;              ///< Rows.
  std::uint64_t seed = 1;
  int width_px = 256, height_px = 192;  ///< Of each view.
  double hfov_deg = 79.0;
};

/// Places spread over the free space (each the farthest from those before), any direction,
/// level. Each view is colour, depth, normals and panoptic image, with the share of the image
/// that the surfels cover and the distance to the nearest training camera.
/// @param camera_positions_m  Of the training views, world frame.
/// @throws core::InputError if there is no room for the robot.
[[nodiscard]] core::Image<core::Rgb8> robot_pictures(
    core::Renderer& renderer, const sim::World& world,
    std::span<const glm::dvec3> camera_positions_m, const RobotPictureOptions& options = {});

}  // namespace segsim::experiments::scenes
