#include "reconstruction/labels/internal/density_clusters.h"

#include <algorithm>
#include <map>
#include <set>
#include <vector>

#include <gtest/gtest.h>

#include "core/random.h"

namespace segsim::reconstruction::internal {
namespace {

struct Blob {
  double x, y, sigma;
  int points;
};

std::vector<float> points_of(const std::vector<Blob>& blobs) {
  core::RandomStream random(1, "blobs");
  std::vector<float> points;
  for (const Blob& blob : blobs) {
    for (int i = 0; i < blob.points; ++i) {
      points.push_back(static_cast<float>(blob.x + blob.sigma * random.normal()));
      points.push_back(static_cast<float>(blob.y + blob.sigma * random.normal()));
    }
  }
  return points;
}

const std::vector<Blob> kBlobs{
    {0.0, 0.0, 0.02, 200}, {1.0, 0.0, 0.1, 300}, {0.4, 1.0, 0.05, 100}};

/// The clusters of each blob's points, without noise.
std::vector<std::set<int>> by_blob(const DensityClusters& found,
                                   const std::vector<Blob>& blobs) {
  std::vector<std::set<int>> clusters;
  std::size_t at = 0;
  for (const Blob& blob : blobs) {
    clusters.emplace_back();
    for (int i = 0; i < blob.points; ++i, ++at) {
      if (found.cluster[at] >= 0) clusters.back().insert(found.cluster[at]);
    }
  }
  return clusters;
}

TEST(DensityClusters, BlobsOfAnyDensityAreClusters) {
  const DensityClusters found =
      density_clusters(points_of(kBlobs), 2, {.min_cluster_size = 30, .min_samples = 5});
  EXPECT_EQ(found.count, 3);
  std::set<int> seen;
  for (const std::set<int>& clusters : by_blob(found, kBlobs)) {
    ASSERT_EQ(clusters.size(), 1U);
    EXPECT_TRUE(seen.insert(*clusters.begin()).second);
  }
  const auto noise = std::count(found.cluster.begin(), found.cluster.end(), -1);
  EXPECT_LT(noise, 90);  // Of 600.
}

TEST(DensityClusters, PointsFarFromAllAreNoise) {
  std::vector<float> points = points_of(kBlobs);
  points.insert(points.end(), {5.0F, 5.0F});
  const DensityClusters found =
      density_clusters(points, 2, {.min_cluster_size = 30, .min_samples = 1});
  EXPECT_EQ(found.cluster.back(), -1);
  EXPECT_EQ(found.probability.back(), 0.0F);
}

TEST(DensityClusters, TheMiddleOfAClusterIsMoreCertainThanItsRim) {
  const std::vector<float> points = points_of(kBlobs);
  const DensityClusters found =
      density_clusters(points, 2, {.min_cluster_size = 30, .min_samples = 5});
  double inside = 0.0, outside = 0.0;
  int inner = 0, outer = 0;
  for (std::size_t i = 200; i < 500; ++i) {  // The second blob, of sigma 0.1 at (1, 0).
    const double dx = static_cast<double>(points[2 * i]) - 1.0;
    const double dy = static_cast<double>(points[2 * i + 1]);
    const double r2 = dx * dx + dy * dy;
    const auto p = static_cast<double>(found.probability[i]);
    EXPECT_GE(p, 0.0);
    EXPECT_LE(p, 1.0);
    if (r2 < 0.05 * 0.05) inside += p, ++inner;
    if (r2 > 0.2 * 0.2) outside += p, ++outer;
  }
  ASSERT_GT(inner, 10);
  ASSERT_GT(outer, 10);
  EXPECT_GT(inside / inner, 1.5 * outside / outer);
}

TEST(DensityClusters, OneBlobIsOneClusterOnlyIfThatIsAllowed) {
  const std::vector<Blob> one{{0.0, 0.0, 0.1, 300}};
  EXPECT_EQ(density_clusters(points_of(one), 2,
                             {.min_cluster_size = 100, .min_samples = 5, .allow_single = true})
                .count,
            1);
  EXPECT_EQ(
      density_clusters(points_of(one), 2, {.min_cluster_size = 100, .min_samples = 5}).count,
      0);
}

TEST(DensityClusters, TheOrderOfPointsDoesNotMatter) {
  const std::vector<float> points = points_of(kBlobs);
  const DensityClusters found = density_clusters(points, 2, {.min_cluster_size = 30});
  std::vector<float> turned;
  for (std::size_t i = points.size() / 2; i-- > 0;) {
    turned.insert(turned.end(), {points[2 * i], points[2 * i + 1]});
  }
  const DensityClusters other = density_clusters(turned, 2, {.min_cluster_size = 30});
  ASSERT_EQ(found.count, other.count);
  std::map<int, int> same;
  for (std::size_t i = 0; i < found.cluster.size(); ++i) {
    const int there = other.cluster[found.cluster.size() - 1 - i];
    const auto [at, is_new] = same.try_emplace(found.cluster[i], there);
    EXPECT_EQ(at->second, there) << i;
  }
}

TEST(DensityClusters, EqualAndFewPointsAreNoTrouble) {
  std::vector<float> points(2 * 50, 0.0F);
  for (std::size_t i = 50; i < points.size(); ++i) points[i] = 1.0F;
  const DensityClusters two = density_clusters(points, 2, {.min_cluster_size = 10});
  EXPECT_EQ(two.count, 2);
  EXPECT_EQ(std::count(two.cluster.begin(), two.cluster.end(), -1), 0);
  EXPECT_EQ(density_clusters(points, 2, {.min_cluster_size = 51}).count, 0);
  EXPECT_EQ(density_clusters({}, 2, {.min_cluster_size = 10}).count, 0);
}

}  // namespace
}  // namespace segsim::reconstruction::internal
