#include "nav/objects/dbscan.h"

#include <algorithm>
#include <numeric>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/random.h"

namespace segsim::nav {
namespace {

using Points = std::vector<glm::vec3>;

bool near(const glm::vec3& a, const glm::vec3& b, double eps_m) {
  return glm::distance(glm::dvec3(a), glm::dvec3(b)) <= eps_m;
}

/// By the definition: core points, then everything that core points reach.
struct Oracle {
  std::vector<bool> core;
  std::vector<int> cluster;
  Oracle(const Points& points, double eps_m, int min_points)
      : core(points.size(), false), cluster(points.size(), -1) {
    for (std::size_t k = 0; k < points.size(); ++k) {
      core[k] = std::count_if(points.begin(), points.end(), [&](const glm::vec3& p) {
                  return near(points[k], p, eps_m);
                }) >= min_points;
    }
    int next = 0;
    for (std::size_t k = 0; k < points.size(); ++k) {
      if (!core[k] || cluster[k] >= 0) continue;
      std::vector<std::size_t> open{k};
      cluster[k] = next;
      while (!open.empty()) {
        const std::size_t at = open.back();
        open.pop_back();
        for (std::size_t n = 0; n < points.size(); ++n) {
          if (core[n] && cluster[n] < 0 && near(points[at], points[n], eps_m)) {
            cluster[n] = next;
            open.push_back(n);
          }
        }
      }
      ++next;
    }
  }
};

TEST(Dbscan, AgreesWithTheDefinition) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    core::RandomStream random(seed, "dbscan");
    Points points;
    for (int blob = 0; blob < 6; ++blob) {
      const glm::dvec3 middle(random.uniform(-2, 2), random.uniform(-2, 2),
                              random.uniform(0, 1));
      const double spread = random.uniform(0.02, 0.3);
      for (int k = 0; k < 60; ++k) {
        points.emplace_back(
            middle + spread * glm::dvec3(random.normal(), random.normal(), random.normal()));
      }
    }
    const double eps_m = random.uniform(0.05, 0.3);
    const int min_points = 2 + static_cast<int>(random.index(20));
    const Oracle oracle(points, eps_m, min_points);
    const std::vector<int> found = dbscan(points, eps_m, min_points);
    for (std::size_t k = 0; k < points.size(); ++k) {
      if (oracle.core[k]) {
        ASSERT_EQ(found[k], oracle.cluster[k]) << seed << " " << k;
        continue;
      }
      // Border: the cluster of its nearest core point; else noise.
      int want = -1;
      double best_m = 1e18;
      for (std::size_t n = 0; n < points.size(); ++n) {
        const double d = glm::distance(glm::dvec3(points[k]), glm::dvec3(points[n]));
        if (oracle.core[n] && d <= eps_m && d < best_m) {
          best_m = d;
          want = oracle.cluster[n];
        }
      }
      ASSERT_EQ(found[k], want) << seed << " " << k;
    }
  }
}

TEST(Dbscan, EdgeCases) {
  EXPECT_TRUE(dbscan({}, 0.1, 3).empty());
  EXPECT_EQ(dbscan({{0, 0, 0}}, 0.1, 1), std::vector<int>{0});
  EXPECT_EQ(dbscan({{0, 0, 0}}, 0.1, 2), std::vector<int>{-1});
  EXPECT_TRUE(largest_dbscan_cluster({{0, 0, 0}, {9, 9, 9}}, 0.1, 2).empty());
  EXPECT_THROW((void)dbscan({}, 0.0, 1), core::ContractViolation);
  // Equal points, and a distance of exactly eps (0.5 is exact).
  EXPECT_EQ(dbscan({{0, 0, 0}, {0, 0, 0}, {0.5F, 0, 0}}, 0.5, 3), (std::vector<int>{0, 0, 0}));
}

TEST(Dbscan, TheLargestCluster) {
  Points points;
  for (int k = 0; k < 10; ++k) points.emplace_back(0.01F * static_cast<float>(k), 0.0F, 0.0F);
  for (int k = 0; k < 20; ++k) points.emplace_back(5.0F, 0.01F * static_cast<float>(k), 0.0F);
  const Points largest = largest_dbscan_cluster(points, 0.05, 3);
  ASSERT_EQ(largest.size(), 20U);
  EXPECT_EQ(largest.front().x, 5.0F);
}

}  // namespace
}  // namespace segsim::nav
