#pragma once

/// @file
/// Point-cloud cleaning with PCL, behind plain types.

#include <optional>
#include <span>
#include <vector>

#include <glm/vec3.hpp>

namespace segsim::worlds {

/// Level plane found among points near z = 0.
struct FloorPlane {
  double height_m = 0.0;             ///< Of the plane at the mean of its points.
  double tilt_rad = 0.0;             ///< Between its normal and z.
  glm::dvec3 normal{0.0, 0.0, 1.0};  ///< Unit, upwards.
  double origin_height_m = 0.0;      ///< Of the plane at x = y = 0.
  std::size_t inliers = 0;
};

/// RANSAC (PCL, its fixed seed) over the points with |z| <= `band_m`; nullopt for fewer than
/// 100 points or if no plane holds a third of them.
[[nodiscard]] std::optional<FloorPlane> find_floor(std::span<const glm::vec3> points_m,
                                                   double band_m);

/// Indices of the points whose mean distance to `neighbors` neighbours is at most the cloud's
/// mean plus `deviations` standard deviations; ascending.
[[nodiscard]] std::vector<std::size_t> without_outliers(std::span<const glm::vec3> points_m,
                                                        int neighbors, double deviations);

}  // namespace segsim::worlds
