#pragma once

/// @file
/// Where a robot is along its path, and the point ahead of it that a follower aims at.

#include <cstddef>
#include <vector>

#include <glm/vec2.hpp>

namespace segsim::nav {

class PathProgress {
 public:
  /// From the start of a new path on.
  void reset() { *this = {}; }
  /// The point `ahead_m` along the path beyond the one nearest to the robot, or its end. The
  /// nearest one only moves on, and by little: a path that comes back near itself is not cut
  /// short. @param points_m  Corners of the path, at least one.
  [[nodiscard]] glm::dvec2 point_ahead(const std::vector<glm::dvec2>& points_m,
                                       const glm::dvec2& position_m, double ahead_m);

 private:
  std::size_t segment_ = 0;  ///< Where the nearest point was found last.
  double segment_t_ = 0.0;
};

}  // namespace segsim::nav
