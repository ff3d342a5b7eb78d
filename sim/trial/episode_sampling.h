#pragma once

/// @file
/// Where episodes start and where their goals may be seen from. Whether a goal really is
/// visible from a candidate is decided by rendering, one level up.

#include <cstdint>
#include <span>
#include <vector>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "core/frames.h"
#include "sim/ground/world.h"

namespace segsim::sim {

/// Free places on a square lattice whose distance to a box (in plan, to its nearest side) is
/// at most `radius_m`, on the largest island, ordered by y, then x.
[[nodiscard]] std::vector<glm::dvec2> view_point_candidates(const World& world,
                                                            const glm::dvec3& box_min_m,
                                                            const glm::dvec3& box_max_m,
                                                            double radius_m = 1.0,
                                                            double lattice_m = 0.25);

/// Poses at `p_m` that look at the centre of a box; for the visibility check.
[[nodiscard]] core::Pose2 facing(const glm::dvec2& p_m, const glm::dvec3& box_min_m,
                                 const glm::dvec3& box_max_m);

struct StartRules {
  double min_geodesic_m = 1.0, max_geodesic_m = 30.0;
  double min_clearance_m = 0.05;  ///< Beyond the circumscribed disc.
  /// Starts whose geodesic is less than this times the straight distance are accepted only
  /// with probability 20 (ratio - 0.98)^2, as Habitat samples them; 1 switches the rule off.
  double min_ratio = 1.05;
  int max_tries = 20000;
};

struct SampledStart {
  core::Pose2 pose;
  double geodesic_m = 0.0;  ///< To the nearest goal.
};

/// How many tries failed, by the rule that refused them.
struct StartRejections {
  int too_near = 0, too_far = 0, unreachable = 0, too_tight = 0, too_straight = 0;
};

/// Uniform on the largest island of the free space, heading uniform; fewer than `count` if
/// `max_tries` run out. Deterministic in `seed`.
[[nodiscard]] std::vector<SampledStart> sample_starts(
    const World& world, std::span<const glm::dvec2> view_points_m, int count,
    std::uint64_t seed, const StartRules& rules = {}, StartRejections* rejections = nullptr);

}  // namespace segsim::sim
