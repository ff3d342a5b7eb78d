#include "experiments/scene_labels/surfel_split.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/random.h"

namespace segsim::experiments::scene_labels {
namespace {

/// A level square of discs, 2 cm apart.
void add_patch(SurfelSet& set, const glm::vec3& corner, int columns, int rows) {
  for (int x = 0; x < columns; ++x) {
    for (int y = 0; y < rows; ++y) {
      set.position_m.push_back(corner + 0.02F * glm::vec3(x, y, 0));
      set.radius_m.push_back(0.01F);
    }
  }
}

SurfelSet random_set(std::uint64_t seed, std::size_t count) {
  core::RandomStream random(seed, "surfels");
  SurfelSet set;
  for (std::size_t i = 0; i < count; ++i) {
    // Negative places too: a cell of the grid must not be two.
    set.position_m.emplace_back(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5),
                                random.uniform(-0.2, 0.2));
    set.radius_m.push_back(static_cast<float>(random.uniform(0.001, 0.08)));
  }
  return set;
}

double reach_m(const SurfelSet& set, double gap_m, std::size_t i, std::size_t j) {
  return gap_m + std::min(set.radius_m[i], kLargestRadius_m) +
         std::min(set.radius_m[j], kLargestRadius_m);
}

/// Of all pairs, straight from the definition.
std::vector<int> plain_pieces(const SurfelSet& set, double gap_m) {
  std::vector<int> piece(set.position_m.size());
  std::iota(piece.begin(), piece.end(), 0);
  for (std::size_t i = 0; i < piece.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (glm::distance(set.position_m[i], set.position_m[j]) > reach_m(set, gap_m, i, j) ||
          piece[i] == piece[j]) {
        continue;
      }
      const int from = piece[i], to = piece[j];
      std::replace(piece.begin(), piece.end(), from, to);
    }
  }
  return piece;
}

TEST(ConnectedPieces, AgreeWithAllPairs) {
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const SurfelSet set = random_set(seed, 250);
    for (const double gap_m : {0.0, 0.02, 0.06}) {
      const std::vector<int> found = connected_pieces(set, gap_m, 0.0);
      const std::vector<int> wanted = plain_pieces(set, gap_m);
      for (std::size_t i = 0; i < found.size(); ++i) {
        for (std::size_t j = 0; j < i; ++j) {
          ASSERT_EQ(found[i] == found[j], wanted[i] == wanted[j]) << i << " " << j;
        }
      }
      // Numbered by size.
      const int pieces = 1 + *std::max_element(found.begin(), found.end());
      for (int k = 1; k < pieces; ++k) {
        ASSERT_LE(std::count(found.begin(), found.end(), k),
                  std::count(found.begin(), found.end(), k - 1));
      }
    }
  }
}

TEST(ConnectedPieces, CrumbsBelongToTheNearestPiece) {
  SurfelSet set;
  add_patch(set, {0.0F, 0.0F, 0.0F}, 10, 10);
  add_patch(set, {1.0F, 0.0F, 0.0F}, 9, 9);
  add_patch(set, {0.9F, 0.0F, 0.0F}, 1, 2);  // Beside the second one.
  const std::vector<int> found = connected_pieces(set, 0.03, 0.02);
  EXPECT_EQ(std::count(found.begin(), found.begin() + 100, 0), 100);
  EXPECT_EQ(std::count(found.begin() + 100, found.end(), 1), 83);
  // They are a piece of their own where crumbs count.
  EXPECT_EQ(connected_pieces(set, 0.03, 0.0).back(), 2);
  // And the gap joins them.
  EXPECT_EQ(connected_pieces(set, 0.085, 0.0).back(), 1);
}

/// Bellman and Ford's relaxation of all pairs.
std::vector<std::vector<double>> plain_distances(const SurfelSet& set, double gap_m,
                                                 const std::vector<std::size_t>& starts) {
  std::vector<std::vector<double>> all;
  for (const std::size_t start : starts) {
    std::vector<double> d(set.position_m.size(), std::numeric_limits<double>::infinity());
    d[start] = 0.0;
    for (bool changed = true; changed;) {
      changed = false;
      for (std::size_t i = 0; i < d.size(); ++i) {
        for (std::size_t j = 0; j < d.size(); ++j) {
          const double step_m = glm::distance(set.position_m[i], set.position_m[j]);
          if (step_m > reach_m(set, gap_m, i, j) || d[i] + step_m >= d[j] - 1e-12) continue;
          d[j] = d[i] + step_m;
          changed = true;
        }
      }
    }
    all.push_back(d);
  }
  return all;
}

TEST(NearestSeeds, AgreeWithShortestPaths) {
  constexpr double kGap_m = 0.045;
  std::size_t reached = 0, unreached = 0;
  for (std::uint64_t seed = 10; seed < 14; ++seed) {
    const SurfelSet set = random_set(seed, 120);
    const std::vector<std::size_t> starts{3, 50, 90};
    std::vector<Seed> seeds;
    for (std::size_t k = 0; k < starts.size(); ++k) {
      // The third click is a second one on the first part.
      seeds.push_back(
          {glm::dvec3(set.position_m[starts[k]]), k == 2 ? 0 : static_cast<int>(k)});
    }
    const std::vector<int> found = nearest_seeds(set, kGap_m, seeds);
    const auto distances = plain_distances(set, kGap_m, starts);
    for (std::size_t i = 0; i < found.size(); ++i) {
      std::size_t best = 0;
      double least = std::numeric_limits<double>::infinity();
      for (std::size_t k = 0; k < starts.size(); ++k) {
        if (distances[k][i] < least) std::tie(best, least) = std::pair(k, distances[k][i]);
      }
      if (std::isfinite(least)) {
        ++reached;
      } else {
        ++unreached;
        for (std::size_t k = 0; k < starts.size(); ++k) {
          const double straight = glm::distance(glm::dvec3(set.position_m[i]), seeds[k].p_m);
          if (straight < least) std::tie(best, least) = std::pair(k, straight);
        }
      }
      ASSERT_EQ(found[i], seeds[best].part) << seed << " " << i;
    }
  }
  EXPECT_GT(reached, 100U);
  EXPECT_GT(unreached, 10U);
}

TEST(NearestSeeds, GrowAlongTheSurfaceNotThroughTheAir) {
  // A horseshoe: the ends are near each other in a straight line.
  SurfelSet set;
  add_patch(set, {0.0F, 0.0F, 0.0F}, 50, 3);
  add_patch(set, {0.0F, 0.3F, 0.0F}, 50, 3);
  add_patch(set, {1.0F, 0.0F, 0.0F}, 3, 18);
  const std::vector<Seed> seeds{{{0.0, 0.0, 0.0}, 0}, {{1.02, 0.34, 0.0}, 1}};
  const std::vector<int> found = nearest_seeds(set, 0.01, seeds);
  EXPECT_EQ(found[150], 1);  // (0, 0.3): 0.3 m from the first seed, but 1 m along the other.
  EXPECT_EQ(found[0], 0);
}

}  // namespace
}  // namespace segsim::experiments::scene_labels
