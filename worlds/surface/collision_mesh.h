#pragma once

/// @file
/// Reconstructed points -> a closed-enough mesh for collision and navigation.
///
///   floor check (RANSAC) -> outliers off -> 5 cm voxels -> floaters off -> faces of what is
///   left
///   + one level floor at z = 0 under everything that was seen, with pin-holes closed
///
/// Evidence is counted in 5 cm voxels; faces are those of the 2.5 cm halves that hold points
/// themselves, so that walls do not grow by a whole voxel.
///
/// A column is floor if floor points fell into it, if it holds an obstacle, if somebody who
/// carried the camera stood there, or if morphological closing reaches it. Columns that nobody
/// ever saw have no floor and thus are not navigable.
///
/// A fused surface (worlds/surface/depth_fusion.h) goes the same way, but its own triangles
/// are the obstacles: they lie where the surface is, not on the faces of voxels. Its floor is
/// replaced by the level one: bumps of a few centimetres, and the holes that furniture leaves
/// in what was seen of the floor, are no obstacles.

#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <glm/vec3.hpp>

#include "sim/ground/triangle_mesh.h"

namespace segsim::worlds {

struct CollisionMeshOptions {
  double voxel_m = 0.05;  ///< Of the evidence; faces are half as large.
  int min_points_per_voxel = 2;
  int min_points_per_column = 5;  ///< Below the ceiling, so that lone specks are no obstacle.
  double ceiling_m = 1.9;         ///< Points above are left out: no robot reaches them.
  double obstacle_min_m = 0.08;   ///< Lower points are floor or its noise.
  double floor_band_m = 0.08;     ///< |z| up to here with an upright normal is floor.
  int outlier_neighbors = 12;     ///< 0 switches the outlier filter off.
  double outlier_deviations =
      2.5;                        ///< Mean neighbour distance beyond mean + this many sigmas.
  int min_cluster_points = 60;    ///< Smaller groups of connected voxels are floaters.
  double close_floor_m = 0.40;    ///< Floor holes up to about this wide are closed.
  double walked_radius_m = 0.40;  ///< Around each camera position the floor is sure.
  /// Somebody says that the floor is at z = 0: it need not be seen where cameras were.
  bool floor_is_known = false;
  /// Without a level plane that stands out near z = 0 so much of it must have been seen.
  double least_floor_m2 = 0.25;
};

struct CollisionMeshResult {
  sim::TriangleMesh mesh;
  std::size_t points = 0, outliers = 0, floaters = 0;
  double floor_height_m = 0.0,
         floor_tilt_rad = 0.0;  ///< Of the floor plane found; NaN if none.
  std::size_t obstacle_voxels = 0;
  double floor_seen_m2 = 0.0, floor_m2 = 0.0;  ///< Before and after closing.
  std::vector<std::string> warnings;           ///< For example a floor that is not at z = 0.

  /// The numbers above by name, for the manifest.
  [[nodiscard]] std::vector<std::pair<std::string, double>> statistics() const;
};

/// @param normals  One per point, or empty.
/// @param camera_positions_m  Of the capture; may be empty.
/// @throws core::InputError if the points leave no floor, or spread too far.
[[nodiscard]] CollisionMeshResult make_collision_mesh(
    std::span<const glm::vec3> points_m, std::span<const glm::vec3> normals,
    std::span<const glm::dvec3> camera_positions_m, const CollisionMeshOptions& options = {});

/// The same from a surface without small pieces (worlds/surface/mesh_cleaning.h). Of the
/// options those about outliers and counts of points do not apply. `obstacle_voxels` counts
/// voxels that the surface meets.
[[nodiscard]] CollisionMeshResult collision_mesh_of_surface(
    const sim::TriangleMesh& surface, std::span<const glm::dvec3> camera_positions_m,
    const CollisionMeshOptions& options = {});

}  // namespace segsim::worlds
