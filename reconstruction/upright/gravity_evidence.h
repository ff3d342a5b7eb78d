#pragma once

/// @file
/// Which way is up, from what a recording shows: surfaces vote for a direction to which
/// floors, tables and ceilings are perpendicular and walls parallel, and cameras, which are
/// seldom rolled and never stand on their heads, tell which of a room's three axes that is,
/// and its sign.

#include <cstddef>
#include <optional>
#include <span>

#include <glm/vec3.hpp>

#include "core/frames.h"
#include "reconstruction/upright/surface_elements.h"

namespace segsim::reconstruction {

struct GravityEvidence {
  glm::dvec3 up{0.0, 0.0, 1.0};  ///< Unit, in the frame of elements and cameras.
  double spread_rad = 0.0;       ///< One standard deviation of the tilt.
  std::size_t elements = 0;      ///< That voted.
  double level_share = 0.0;      ///< Of the elements: normal within 8 degrees of up or down.
  double wall_share = 0.0;       ///< Of the elements: normal within 8 degrees of level.
  double upright_share = 0.0;    ///< Of the cameras: rolled by less than 20 degrees.
  /// How much better than the best direction more than 30 degrees away; 1 = as good.
  double lead = 0.0;

  /// Enough of all of it to contradict what a layout says about its axes.
  [[nodiscard]] bool sure() const;
};

/// @param cameras  Poses in the frame of the elements.
/// @return  nullopt without cameras, or without elements that fix a direction.
[[nodiscard]] std::optional<GravityEvidence> find_gravity(
    std::span<const SurfaceElement> elements, std::span<const core::CameraPose> cameras);

/// Up by the cameras alone, within some degrees: their images' right is level. A guess, for
/// recordings that show no surfaces.
/// @return  nullopt with fewer than 8 cameras, or if they were held any way.
[[nodiscard]] std::optional<glm::dvec3> up_of_cameras(
    std::span<const core::CameraPose> cameras);

}  // namespace segsim::reconstruction
