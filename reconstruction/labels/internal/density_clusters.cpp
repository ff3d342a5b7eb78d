#include "reconstruction/labels/internal/density_clusters.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <ATen/Parallel.h>

#include "core/check.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr std::int64_t kPointsPerTask = 64;
/// Equal points are as dense as those at this share of the longest edge.
constexpr double kShortestEdge = 1e-6;

/// Coordinates one after the other, so that distances to a point are sums of whole rows.
class PointTable {
 public:
  PointTable(std::span<const float> points, std::size_t dimensions)
      : count_(dimensions == 0 ? 0 : points.size() / dimensions), dimensions_(dimensions) {
    SEGSIM_CHECK(dimensions > 0 && points.size() % dimensions == 0, "points");
    coordinate_.resize(points.size());
    for (std::size_t i = 0; i < count_; ++i) {
      for (std::size_t d = 0; d < dimensions; ++d) {
        coordinate_[d * count_ + i] = points[i * dimensions + d];
      }
    }
  }
  [[nodiscard]] std::size_t count() const { return count_; }

  /// Squared distances of all points to one. @param out  [count()].
  void distances2(std::size_t to, float* __restrict out) const {
    std::fill(out, out + count_, 0.0F);
    for (std::size_t d = 0; d < dimensions_; ++d) {
      const float* __restrict x = coordinate_.data() + d * count_;
      const float at = x[to];
      for (std::size_t i = 0; i < count_; ++i) out[i] += (x[i] - at) * (x[i] - at);
    }
  }

 private:
  std::size_t count_, dimensions_;
  std::vector<float> coordinate_;
};

/// Squared distance of every point to its k-th neighbour.
std::vector<float> core_distances2(const PointTable& points, int min_samples) {
  std::vector<float> core(points.count(), 0.0F);
  const auto k = std::min(static_cast<std::size_t>(min_samples), points.count() - 1);
  const auto all = static_cast<std::int64_t>(points.count());
  at::parallel_for(0, all, kPointsPerTask, [&](std::int64_t begin, std::int64_t end) {
    std::vector<float> distance2(points.count());
    for (std::int64_t i = begin; i < end; ++i) {
      points.distances2(static_cast<std::size_t>(i), distance2.data());
      std::nth_element(distance2.begin(), distance2.begin() + static_cast<std::ptrdiff_t>(k),
                       distance2.end());  // The point itself is the nearest.
      core[static_cast<std::size_t>(i)] = distance2[k];
    }
  });
  return core;
}

struct Edge {
  std::size_t a, b;
  float length;
};

/// The minimum spanning tree (Prim), shortest edge first.
std::vector<Edge> spanning_tree(const PointTable& points, const std::vector<float>& core2) {
  const std::size_t n = points.count();
  std::vector<float> distance2(n), best(n, kInfinity);
  std::vector<std::size_t> from(n, 0);
  std::vector<bool> done(n, false);
  std::vector<Edge> edges;
  for (std::size_t at = 0; edges.size() + 1 < n;) {
    done[at] = true;
    points.distances2(at, distance2.data());
    std::size_t next = n;
    for (std::size_t i = 0; i < n; ++i) {
      if (done[i]) continue;
      const float length2 = std::max({distance2[i], core2[i], core2[at]});
      if (length2 < best[i]) best[i] = length2, from[i] = at;
      if (next == n || best[i] < best[next]) next = i;
    }
    edges.push_back({from[next], next, std::sqrt(best[next])});
    at = next;
  }
  std::stable_sort(edges.begin(), edges.end(),
                   [](const Edge& a, const Edge& b) { return a.length < b.length; });
  return edges;
}

/// Groups of the dendrogram: below n a point, from n on the union of two groups.
struct Dendrogram {
  Dendrogram(std::size_t count, const std::vector<Edge>& edges)
      : points(count), size(count, 1), parent(2 * count) {
    std::iota(parent.begin(), parent.end(), std::size_t{0});
    const double shortest =
        edges.empty() ? 1.0 : kShortestEdge * static_cast<double>(edges.back().length);
    for (const Edge& edge : edges) {
      const std::size_t a = root(edge.a), b = root(edge.b), joined = size.size();
      child.push_back({a, b});
      density.push_back(1.0 / std::max({static_cast<double>(edge.length), shortest, 1e-30}));
      size.push_back(size[a] + size[b]);
      parent[a] = parent[b] = joined;
    }
  }
  [[nodiscard]] std::size_t root(std::size_t group) {
    while (parent[group] != group) group = parent[group] = parent[parent[group]];
    return group;
  }

  std::size_t points;
  std::vector<std::size_t> size;                           ///< By group.
  std::vector<std::pair<std::size_t, std::size_t>> child;  ///< By group - points.
  std::vector<double> density;                             ///< By group - points: 1 / edge.
  std::vector<std::size_t> parent;
};

/// The dendrogram without splits that only shed a few points.
struct Condensed {
  struct Cluster {
    std::size_t parent;
    double birth;            ///< Density at which it splits off.
    double stability = 0.0;  ///< Excess of mass.
    bool chosen = false;
  };
  std::vector<Cluster> clusters;        ///< Parents before children; the first is all.
  std::vector<std::size_t> cluster_of;  ///< [points]: the last that held it ...
  std::vector<double> density;          ///< ... and the density at which it left.
};

Condensed condense(const Dendrogram& tree, std::size_t min_size) {
  Condensed out;
  out.cluster_of.assign(tree.points, 0);
  out.density.assign(tree.points, 0.0);
  out.clusters.push_back({0, 0.0});
  struct Task {
    std::size_t group, cluster;
    double shed;  ///< > 0: the group left its cluster at this density.
  };
  std::vector<Task> open{{tree.size.size() - 1, 0, 0.0}};
  while (!open.empty()) {
    const Task task = open.back();
    open.pop_back();
    if (task.group < tree.points) {
      out.cluster_of[task.group] = task.cluster;
      out.density[task.group] = task.shed;
      Condensed::Cluster& cluster = out.clusters[task.cluster];
      cluster.stability += task.shed - cluster.birth;
      continue;
    }
    const auto [a, b] = tree.child[task.group - tree.points];
    const double density = tree.density[task.group - tree.points];
    if (task.shed > 0.0) {
      open.push_back({a, task.cluster, task.shed});
      open.push_back({b, task.cluster, task.shed});
      continue;
    }
    const bool split = tree.size[a] >= min_size && tree.size[b] >= min_size;
    for (const std::size_t part : {a, b}) {
      if (split) {
        out.clusters[task.cluster].stability += static_cast<double>(tree.size[part]) *
                                                (density - out.clusters[task.cluster].birth);
        open.push_back({part, out.clusters.size(), 0.0});
        out.clusters.push_back({task.cluster, density});
      } else {
        // The larger part goes on as the cluster, unless both are too small.
        const bool goes_on = tree.size[part] >= min_size;
        open.push_back({part, task.cluster, goes_on ? 0.0 : density});
      }
    }
  }
  return out;
}

/// Of a cluster and what it splits into, whichever has more excess of mass.
void choose(Condensed& tree, bool allow_single) {
  std::vector<double> of_children(tree.clusters.size(), 0.0);
  std::vector<double> best(tree.clusters.size(), 0.0);
  for (std::size_t c = tree.clusters.size(); c-- > 0;) {
    Condensed::Cluster& cluster = tree.clusters[c];
    cluster.chosen = (c > 0 || allow_single) && cluster.stability >= of_children[c];
    best[c] = cluster.chosen ? cluster.stability : of_children[c];
    if (c > 0) of_children[cluster.parent] += best[c];
  }
  for (std::size_t c = 1; c < tree.clusters.size(); ++c) {  // Only the topmost.
    for (std::size_t p = tree.clusters[c].parent;; p = tree.clusters[p].parent) {
      if (tree.clusters[p].chosen) tree.clusters[c].chosen = false;
      if (p == 0) break;
    }
  }
}

}  // namespace

DensityClusterOptions cluster_options(const DensityClusteringConfig& config,
                                      std::size_t points, bool allow_single) {
  const auto least = std::lround(config.min_share * static_cast<double>(points));
  return {.min_cluster_size = static_cast<int>(std::max(2L, least)),
          .min_samples = config.min_samples,
          .allow_single = allow_single};
}

DensityClusters density_clusters(std::span<const float> points, std::size_t dimensions,
                                 const DensityClusterOptions& options) {
  SEGSIM_CHECK(options.min_cluster_size >= 2 && options.min_samples >= 1, "clusters");
  const PointTable table(points, dimensions);
  DensityClusters result;
  result.cluster.assign(table.count(), -1);
  result.probability.assign(table.count(), 0.0F);
  const auto min_size = static_cast<std::size_t>(options.min_cluster_size);
  if (table.count() < min_size) return result;
  const std::vector<Edge> edges =
      spanning_tree(table, core_distances2(table, options.min_samples));
  Condensed tree = condense(Dendrogram(table.count(), edges), min_size);
  choose(tree, options.allow_single);
  std::vector<int> number(tree.clusters.size(), -1);
  for (std::size_t c = 0; c < tree.clusters.size(); ++c) {
    if (tree.clusters[c].chosen) number[c] = result.count++;
  }
  std::vector<double> densest(static_cast<std::size_t>(result.count), 0.0);
  for (std::size_t i = 0; i < table.count(); ++i) {
    std::size_t c = tree.cluster_of[i];
    while (c != 0 && number[c] < 0) c = tree.clusters[c].parent;
    result.cluster[i] = number[c];
    if (number[c] < 0) continue;
    double& most = densest[static_cast<std::size_t>(number[c])];
    most = std::max(most, tree.density[i]);
  }
  for (std::size_t i = 0; i < table.count(); ++i) {
    if (result.cluster[i] < 0) continue;
    const double most = densest[static_cast<std::size_t>(result.cluster[i])];
    result.probability[i] =
        static_cast<float>(most > 0.0 ? std::min(tree.density[i] / most, 1.0) : 1.0);
  }
  return result;
}

std::vector<float> cluster_means(std::span<const float> points, std::size_t dimensions,
                                 const DensityClusters& clusters) {
  const auto count = static_cast<std::size_t>(clusters.count);
  std::vector<double> sum(count * dimensions, 0.0), weight(count, 0.0);
  for (std::size_t i = 0; i < clusters.cluster.size(); ++i) {
    if (clusters.cluster[i] < 0) continue;
    const auto c = static_cast<std::size_t>(clusters.cluster[i]);
    const auto share = static_cast<double>(clusters.probability[i]);
    weight[c] += share;
    for (std::size_t d = 0; d < dimensions; ++d) {
      sum[c * dimensions + d] += share * static_cast<double>(points[i * dimensions + d]);
    }
  }
  std::vector<float> mean;
  for (std::size_t i = 0; i < sum.size(); ++i) {
    mean.push_back(static_cast<float>(sum[i] / std::max(weight[i / dimensions], 1e-30)));
  }
  return mean;
}

}  // namespace segsim::reconstruction::internal
