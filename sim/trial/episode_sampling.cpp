#include "sim/trial/episode_sampling.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim {
namespace {

constexpr int kLargestIsland = 1;

glm::dvec2 nearest_in_box(const glm::dvec2& p_m, const glm::dvec3& min_m,
                          const glm::dvec3& max_m) {
  return glm::clamp(p_m, glm::dvec2(min_m), glm::dvec2(max_m));
}

double straight_to_nearest(const glm::dvec2& p_m, std::span<const glm::dvec2> goals_m) {
  double best_m = std::numeric_limits<double>::infinity();
  for (const glm::dvec2& goal : goals_m) best_m = std::min(best_m, glm::distance(goal, p_m));
  return best_m;
}

}  // namespace

std::vector<glm::dvec2> view_point_candidates(const World& world, const glm::dvec3& box_min_m,
                                              const glm::dvec3& box_max_m, double radius_m,
                                              double lattice_m) {
  SEGSIM_CHECK(lattice_m > 0.0 && radius_m > 0.0, "lattice");
  const auto first = [&](double lo) {
    return static_cast<int>(std::ceil((lo - radius_m) / lattice_m));
  };
  const auto last = [&](double hi) {
    return static_cast<int>(std::floor((hi + radius_m) / lattice_m));
  };
  std::vector<glm::dvec2> candidates;
  for (int j = first(box_min_m.y); j <= last(box_max_m.y); ++j) {
    for (int i = first(box_min_m.x); i <= last(box_max_m.x); ++i) {
      const glm::dvec2 p_m = lattice_m * glm::dvec2(i, j);
      if (glm::distance(p_m, nearest_in_box(p_m, box_min_m, box_max_m)) > radius_m) continue;
      if (world.free_space().island_at(p_m) == kLargestIsland) candidates.push_back(p_m);
    }
  }
  return candidates;
}

core::Pose2 facing(const glm::dvec2& p_m, const glm::dvec3& box_min_m,
                   const glm::dvec3& box_max_m) {
  const glm::dvec2 to = 0.5 * glm::dvec2(box_min_m + box_max_m) - p_m;
  return {p_m.x, p_m.y, std::atan2(to.y, to.x)};
}

std::vector<SampledStart> sample_starts(const World& world,
                                        std::span<const glm::dvec2> view_points_m, int count,
                                        std::uint64_t seed, const StartRules& rules,
                                        StartRejections* rejections) {
  const FreeSpace& space = world.free_space();
  const DistanceField field = world.distance_to(view_points_m);
  std::vector<glm::ivec2> cells;
  for (int j = 0; j < space.frame.height; ++j) {
    for (int i = 0; i < space.frame.width; ++i) {
      if (space.island(i, j) == kLargestIsland) cells.emplace_back(i, j);
    }
  }
  StartRejections refused;
  std::vector<SampledStart> starts;
  const double room_m = space.radius_m + rules.min_clearance_m;
  for (int k = 0; k < rules.max_tries && static_cast<int>(starts.size()) < count; ++k) {
    // One stream per try: rules that draw more or less do not shift the later tries.
    core::RandomStream random(seed, "episode_start", static_cast<std::uint64_t>(k));
    const glm::ivec2 cell = cells[random.index(static_cast<std::uint32_t>(cells.size()))];
    const double in_x = random.uniform();
    const double in_y = random.uniform();
    const double yaw_rad = core::wrap_angle_rad(2.0 * std::numbers::pi * random.uniform());
    const glm::dvec2 p_m = space.frame.origin_m +
                           space.frame.cell_m * (glm::dvec2(cell) + glm::dvec2(in_x, in_y));
    const core::Pose2 pose{p_m.x, p_m.y, yaw_rad};
    const double geodesic_m = field.at(p_m);
    if (!std::isfinite(geodesic_m)) {
      ++refused.unreachable;
    } else if (geodesic_m < rules.min_geodesic_m) {
      ++refused.too_near;
    } else if (geodesic_m > rules.max_geodesic_m) {
      ++refused.too_far;
    } else if (world.collision().body_distance_m(p_m) < room_m ||
               world.collision().collides(pose)) {
      ++refused.too_tight;
    } else {
      const double ratio = geodesic_m / straight_to_nearest(p_m, view_points_m);
      const double keep = 20.0 * (ratio - 0.98) * (ratio - 0.98);
      if (ratio < rules.min_ratio && rules.min_ratio > 1.0 && !random.chance(keep)) {
        ++refused.too_straight;
      } else {
        starts.push_back({pose, geodesic_m});
      }
    }
  }
  if (rejections != nullptr) *rejections = refused;
  return starts;
}

}  // namespace segsim::sim
