#pragma once

/// @file
/// The only door to PCL in this module.

#include <vector>

#include <glm/vec3.hpp>

namespace segsim::nav::internal {

/// One point per voxel (the mean of its points), in PCL's voxel order.
[[nodiscard]] std::vector<glm::vec3> thinned(const std::vector<glm::vec3>& points_m,
                                             double voxel_m);

/// The largest group of points linked by gaps of at most `gap_m`; empty if it has fewer than
/// `min_points`. Ties go to the group that PCL lists first.
[[nodiscard]] std::vector<glm::vec3> largest_cluster(const std::vector<glm::vec3>& points_m,
                                                     double gap_m, int min_points);

}  // namespace segsim::nav::internal
