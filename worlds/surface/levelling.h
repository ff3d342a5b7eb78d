#pragma once

/// @file
/// Puts the floor of a reconstruction to z = 0. Recordings come with a floor that was fitted
/// in height alone, from a few frames; the finished surface knows it better, and its tilt.

#include <optional>
#include <span>

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

#include "sim/ground/triangle_mesh.h"

namespace segsim::worlds {

struct LevellingOptions {
  double band_m = 0.3;  ///< The floor is looked for at |z| up to here.
  /// A floor this close to z = 0 and this level is left alone: nothing gains from moving a
  /// world by less than its own noise.
  double height_tolerance_m = 0.01;
  double tilt_tolerance_rad = 0.0035;
};

struct FloorLevelling {
  double height_m = 0.0;  ///< Of the floor at x = y = 0, before.
  double tilt_rad = 0.0;  ///< Of the floor, before.
  bool applied = false;   ///< False within the tolerances; R and t are then the identity.
  /// p_level = R p + t. The point of the floor at x = y = 0 becomes the origin.
  glm::dquat R_level{1.0, 0.0, 0.0, 0.0};
  glm::dvec3 t_level_m{0.0};
};

/// Finds the largest nearly level plane among the upright triangles near z = 0 (PCL's RANSAC
/// with refinement, worlds/surface/point_hygiene.h).
/// @param surface  Of vertices that are spread evenly, as marching cubes leaves them.
/// @return  nullopt if there is no such plane.
[[nodiscard]] std::optional<FloorLevelling> find_levelling(
    const sim::TriangleMesh& surface, const LevellingOptions& options = {});

/// The same from points with normals.
[[nodiscard]] std::optional<FloorLevelling> find_levelling(
    std::span<const glm::vec3> points_m, std::span<const glm::vec3> normals,
    const LevellingOptions& options = {});

}  // namespace segsim::worlds
