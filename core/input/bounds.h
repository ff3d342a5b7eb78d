#pragma once

/// @file
/// How large numbers of files and flags may be: far beyond what any scene needs, and far below
/// where single precision overflows, an index wraps or memory ends. Whoever reads them refuses
/// what lies beyond, so that no library has to cope with it.

#include <cmath>
#include <cstdint>

#include <glm/vec3.hpp>

namespace segsim::core {

/// Of a coordinate of the world, from its origin. Its square still fits into a float, which is
/// what ray casting and path search compute with.
constexpr double kFarthest_m = 1e7;

/// Of one image: 400 MB as RGB.
constexpr std::int64_t kMostPixels = std::int64_t{1} << 27;

/// Of a grid over the ground: at 5 cm a square of 390 m. Fields over it take up to 20 bytes a
/// cell.
constexpr double kMostGroundCells = 6e7;

/// False for what is not finite, too.
[[nodiscard]] inline bool within_world(double coordinate_m) {
  return std::abs(coordinate_m) <= kFarthest_m;
}
[[nodiscard]] inline bool within_world(const glm::dvec3& p_m) {
  return within_world(p_m.x) && within_world(p_m.y) && within_world(p_m.z);
}

}  // namespace segsim::core
