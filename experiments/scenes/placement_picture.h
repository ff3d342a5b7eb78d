#pragma once

/// @file
/// What was decided about up and floor of a recording, to be judged at a glance.

#include <span>

#include <glm/vec3.hpp>

#include "core/image.h"
#include "reconstruction/datasets/world_placement.h"

namespace segsim::experiments::scenes {

/// Side view of the patches of surface that were asked, with cameras, floor and gravity, and
/// beside it how much surface there is at each height: level ones seen from above and from
/// below, and walls.
/// @param camera_positions_m  World frame.
/// @return  Empty if nothing had to be found out about the recording.
[[nodiscard]] core::Image<core::Rgb8> placement_picture(
    const reconstruction::WorldPlacement& placement,
    std::span<const glm::dvec3> camera_positions_m);

}  // namespace segsim::experiments::scenes
