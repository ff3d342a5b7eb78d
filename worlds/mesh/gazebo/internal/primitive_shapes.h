#pragma once

/// @file
/// The solids that SDF has names for, centred on the origin of their visual; z is their axis.
/// All faces look outwards.

#include <glm/vec3.hpp>

#include "worlds/mesh/internal/mesh_parts.h"

namespace segsim::worlds::internal {

[[nodiscard]] MeshPart sphere(double radius_m);
/// @param length_m  Between the centres of the round ends.
[[nodiscard]] MeshPart capsule(double radius_m, double length_m);
[[nodiscard]] MeshPart cylinder(double radius_m, double length_m);
[[nodiscard]] MeshPart box(const glm::dvec3& size_m);
/// @param normal  Unit; the side that is seen.
[[nodiscard]] MeshPart plane(const glm::dvec3& normal, double width_m, double height_m);

}  // namespace segsim::worlds::internal
