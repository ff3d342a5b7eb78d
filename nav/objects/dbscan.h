#pragma once

/// @file
/// DBSCAN (Ester et al. 1996) in three dimensions, on a grid of cells of side eps / sqrt(3):
/// all points of a cell are neighbours of one another, so a cell with `min_points` points
/// needs no search (after Gan and Tao 2015). PCL 1.13 has Euclidean clustering only, and a
/// radius search per point of a dense cloud costs a hundred times more.

#include <vector>

#include <glm/vec3.hpp>

namespace segsim::nav {

/// Cluster of each point, from 0 in the order of their first core point; -1 = noise. A point
/// is a core point if at least `min_points` points, itself included, lie within `eps_m`
/// (closed). Border points go to the cluster of their nearest core point (ties: lowest index).
[[nodiscard]] std::vector<int> dbscan(const std::vector<glm::vec3>& points_m, double eps_m,
                                      int min_points);

/// The points of the largest cluster in their order; empty if there is none. Ties: the cluster
/// that comes first.
[[nodiscard]] std::vector<glm::vec3> largest_dbscan_cluster(
    const std::vector<glm::vec3>& points_m, double eps_m, int min_points);

}  // namespace segsim::nav
