#pragma once

/// @file
/// Clusters by density, of any number and shape: HDBSCAN (Campello, Moulavi and Sander 2013,
/// "Density-based clustering based on hierarchical density estimates"), with clusters chosen
/// by excess of mass. Points are joined by the minimum spanning tree of
///
///     max(core_a, core_b, |a - b|)     core_a: distance of a to its min_samples-th neighbour
///
/// No library that the minimal build for CUDA machines has knows it. O(n^2) distances, without
/// their storage.

#include <cstddef>
#include <span>
#include <vector>

#include "reconstruction/labels/heads/baseline_config.h"

namespace segsim::reconstruction::internal {

struct DensityClusterOptions {
  int min_cluster_size = 100;  ///< >= 2.
  int min_samples = 1;
  bool allow_single = false;  ///< All points may be one cluster.
};

struct DensityClusters {
  std::vector<int> cluster;        ///< [points], -1 = noise.
  std::vector<float> probability;  ///< [points], in [0, 1]: how deep inside; 0 for noise.
  int count = 0;
};

/// @param points  How many there are.
[[nodiscard]] DensityClusterOptions cluster_options(const DensityClusteringConfig& config,
                                                    std::size_t points, bool allow_single);

/// @param points  [n, dimensions], finite.  Deterministic for any number of threads.
[[nodiscard]] DensityClusters density_clusters(std::span<const float> points,
                                               std::size_t dimensions,
                                               const DensityClusterOptions& options);

/// [clusters, dimensions]: the mean of each cluster's points, weighed by probability.
[[nodiscard]] std::vector<float> cluster_means(std::span<const float> points,
                                               std::size_t dimensions,
                                               const DensityClusters& clusters);

}  // namespace segsim::reconstruction::internal
