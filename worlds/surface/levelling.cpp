#include "worlds/surface/levelling.h"

#include <cmath>
#include <vector>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "worlds/surface/mesh_cleaning.h"
#include "worlds/surface/point_hygiene.h"

namespace segsim::worlds {
namespace {

/// Walls and the sides of furniture are no floor, whatever their height.
constexpr float kUpright = 0.9F;

/// The shortest turn that brings `normal` (z > 0) to +z.
glm::dquat upright_turn(const glm::dvec3& normal) {
  const glm::dvec3 axis(normal.y, -normal.x, 0.0);  // normal x z
  return glm::normalize(glm::dquat(1.0 + normal.z, axis.x, axis.y, axis.z));
}

std::optional<FloorLevelling> levelling_of(std::span<const glm::vec3> upright_m,
                                           const LevellingOptions& options) {
  const auto plane = find_floor(upright_m, options.band_m);
  if (!plane) return std::nullopt;
  FloorLevelling result;
  result.height_m = plane->origin_height_m;
  result.tilt_rad = plane->tilt_rad;
  // Both heights: a tilted floor may pass through the origin and be wrong everywhere else.
  result.applied = std::abs(plane->origin_height_m) > options.height_tolerance_m ||
                   std::abs(plane->height_m) > options.height_tolerance_m ||
                   plane->tilt_rad > options.tilt_tolerance_rad;
  if (result.applied) {
    result.R_level = upright_turn(plane->normal);
    result.t_level_m = -(result.R_level * glm::dvec3(0.0, 0.0, plane->origin_height_m));
  }
  return result;
}

}  // namespace

std::optional<FloorLevelling> find_levelling(const sim::TriangleMesh& surface,
                                             const LevellingOptions& options) {
  std::vector<glm::vec3> upright_m;
  for (const glm::uvec3& t : surface.triangles) {
    if (triangle_normal(surface, t).z <= kUpright) continue;
    upright_m.push_back(
        (surface.positions_m[t.x] + surface.positions_m[t.y] + surface.positions_m[t.z]) /
        3.0F);
  }
  return levelling_of(upright_m, options);
}

std::optional<FloorLevelling> find_levelling(std::span<const glm::vec3> points_m,
                                             std::span<const glm::vec3> normals,
                                             const LevellingOptions& options) {
  SEGSIM_CHECK(normals.size() == points_m.size(), "one normal per point");
  std::vector<glm::vec3> upright_m;
  for (std::size_t k = 0; k < points_m.size(); ++k) {
    if (std::abs(normals[k].z) > kUpright) upright_m.push_back(points_m[k]);
  }
  return levelling_of(upright_m, options);
}

}  // namespace segsim::worlds
