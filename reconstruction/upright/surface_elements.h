#pragma once

/// @file
/// Patches of surface, one for each voxel that a plane runs through: what votes for the
/// direction of gravity and for the floor. Every voxel counts once, however often it was seen,
/// so that shares of elements are shares of area.

#include <span>
#include <vector>

#include <glm/vec3.hpp>

namespace segsim::reconstruction {

struct SeenPoint {
  glm::vec3 position_m;   ///< In any fixed frame.
  glm::vec3 seen_from_m;  ///< Where the camera was.
};

struct SurfaceElement {
  glm::dvec3 position_m;  ///< Mean of the voxel's points.
  glm::dvec3 normal;      ///< Unit, towards where it was seen from.
};

/// Edge of the voxels that the program uses.
inline constexpr double kElement_m = 0.1;

/// Fits a plane to the points of each voxel and its 26 neighbours. Voxels with few points,
/// and those on edges or in clutter, give no element. Points that are not finite, or more than
/// 100 km away, are left out.
[[nodiscard]] std::vector<SurfaceElement> surface_elements(std::span<const SeenPoint> points,
                                                           double voxel_m = kElement_m);

}  // namespace segsim::reconstruction
