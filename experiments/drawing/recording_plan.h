#pragma once

/// @file
/// A recording seen from above: where the cameras were and where they looked.

#include <span>
#include <string>
#include <vector>

#include <glm/vec3.hpp>

#include "core/frames.h"
#include "core/image.h"

namespace segsim::experiments::drawing {

struct RecordingPlan {
  std::string title;
  std::vector<glm::vec3> points_m;     ///< What depth measured, in the world.
  std::vector<core::CameraPose> path;  ///< T_world_camera of all frames.
  double horizontal_fov_rad = 1.0;
  std::vector<std::size_t> marked;  ///< Frames that stand out, for a cross each.
  /// Frames that look into equal sectors of yaw, from +x on counter-clockwise.
  std::vector<int> frames_of_sector;
};

/// World +x to the right, +y up. Walls and furniture at the height of the cameras are grey,
/// the floor is the greener the more cameras look over it, the path goes from blue to red, and
/// a rose tells how many frames look into each direction: none is red.
[[nodiscard]] core::Image<core::Rgb8> draw_recording_plan(const RecordingPlan& plan);

}  // namespace segsim::experiments::drawing
