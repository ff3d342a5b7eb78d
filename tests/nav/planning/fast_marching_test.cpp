#include "nav/planning/fast_marching.h"

#include <cmath>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "nav/planning/grid_planner.h"
#include "tests/nav/text_map.h"

namespace segsim::nav {
namespace {

using test::text_map;

TEST(FastMarching, DistancesOnOpenFloorAreNearlyRound) {
  const std::vector<std::string> rows(81, std::string(81, '.'));
  const CostMap map = text_map(rows, test::thin_options());
  const core::Image<float> field = fast_marching_m(map, {{40, 40}});
  double worst = 0.0;
  for (int j = 0; j < 81; ++j) {
    for (int i = 0; i < 81; ++i) {
      const double truth = 0.1 * std::hypot(i - 40, j - 40);
      if (truth < 1.0) continue;
      EXPECT_GE(field(i, j), truth - 1e-4);  // First order: never too short.
      worst = std::max(worst, static_cast<double>(field(i, j)) / truth - 1.0);
    }
  }
  // Dijkstra with eight neighbours is up to 8.2 % long, everywhere at 22.5 degrees.
  EXPECT_LT(worst, 0.09);
  EXPECT_NEAR(field(80, 40), 4.0, 1e-3);
  EXPECT_NEAR(field(80, 80), 4.0 * std::sqrt(2.0), 0.2);
}

TEST(FastMarching, GoesRoundWallsLikeTheShortestPath) {
  const CostMap map = text_map({"...........", "...........", "..#########", "...........",
                                "...........", "#########..", "...........", "..........."},
                               test::thin_options());
  const core::Image<float> field = fast_marching_m(map, {{9, 7}});
  const auto dijkstra = geodesic_field(map, {9, 7});
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 11; ++i) {
      ASSERT_EQ(std::isfinite(field(i, j)), dijkstra->reachable({i, j}));
      // First order on so coarse a grid.
      if (dijkstra->reachable({i, j})) {
        ASSERT_NEAR(field(i, j), dijkstra->cost_m(i, j), 0.15 * dijkstra->cost_m(i, j) + 0.05);
      }
    }
  }
}

TEST(FastMarching, DescendingLeadsToTheGoal) {
  const CostMap map = text_map({"...........", "...........", "..#########", "...........",
                                "...........", "#########..", "...........", "..........."},
                               test::thin_options());
  const Cell goal(9, 7);
  const core::Image<float> field = fast_marching_m(map, {goal});
  Cell at(0, 0);
  int steps = 0;
  while (at != goal && steps < 40) {
    const auto next = short_term_goal(map, field, at);
    ASSERT_TRUE(next);
    ASSERT_TRUE(
        segment_traversable(map, map.frame().center_m(at), map.frame().center_m(*next)));
    at = *next;
    ++steps;
  }
  EXPECT_EQ(at, goal);
  EXPECT_FALSE(short_term_goal(map, field, goal));
}

TEST(FastMarching, NoGoalNoWay) {
  const CostMap map = text_map({"..#..", "..#..", "..#.."}, test::thin_options());
  const core::Image<float> none = fast_marching_m(map, {{2, 1}});
  for (const float d : none.pixels()) EXPECT_TRUE(std::isinf(d));
  const core::Image<float> field = fast_marching_m(map, {{0, 0}});
  EXPECT_TRUE(std::isinf(field(4, 0)));
  EXPECT_FALSE(short_term_goal(map, field, {4, 0}, 1));
  EXPECT_FALSE(short_term_goal(map, field, {-3, 0}));
}

}  // namespace
}  // namespace segsim::nav
