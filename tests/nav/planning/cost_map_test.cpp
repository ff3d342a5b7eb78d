#include "nav/planning/cost_map.h"

#include <cmath>

#include <gmock/gmock.h>

#include "tests/nav/text_map.h"

namespace segsim::nav {
namespace {

using test::random_map;
using test::text_map;

TEST(CostMap, ClearanceEqualsBruteForce) {
  const CostMap map = random_map(40, 0.03, 5, {});
  for (int j = 0; j < 40; ++j) {
    for (int i = 0; i < 40; ++i) {
      double best = 1e18;
      for (int y = 0; y < 40; ++y) {
        for (int x = 0; x < 40; ++x) {
          if (map.state({x, y}) == CellState::kOccupied) {
            best = std::min(best, 0.1 * std::hypot(x - i, y - j));
          }
        }
      }
      ASSERT_NEAR(static_cast<double>(map.clearance_m({i, j})), best, 1e-4) << i << " " << j;
      ASSERT_EQ(map.traversable({i, j}), best >= 0.35 - 1e-6) << i << " " << j;
    }
  }
}

TEST(CostMap, TableKeepsTheMastAwayNotTheBody) {
  CostMapOptions options;
  const CostMap map =
      text_map({".........", ".........", "....m....", ".........", "........."}, options);
  EXPECT_FALSE(map.traversable({4, 2}));
  EXPECT_TRUE(map.traversable({6, 2}));  // 0.2 m away: the body may go below the top.
}

TEST(CostMap, CostRisesTowardsTheWall) {
  const CostMap map = text_map({"#.................."}, {});
  float last = map.length_cost({4, 0});
  EXPECT_GT(last, 1.5F);
  EXPECT_LE(last, 5.0F);
  for (int i = 5; i < 19; ++i) {
    EXPECT_LE(map.length_cost({i, 0}), last);
    last = map.length_cost({i, 0});
  }
  EXPECT_FLOAT_EQ(last, 1.0F);
}

TEST(CostMap, SmallPocketsAreFreeLargeOnesAndTheOutsideAreNot) {
  CostMapOptions options = test::thin_options();
  options.fill_pocket_m2 = 0.045;  // Four cells of 0.01 m2.
  const CostMap map = text_map({"?........", "..??.....", "..??.....", ".........",
                                ".....???.", ".....???.", "........."},
                               options);
  EXPECT_TRUE(map.traversable({2, 4}));
  EXPECT_FALSE(map.traversable({6, 1}));
  EXPECT_FALSE(map.traversable({0, 6}));
}

TEST(CostMap, CrossingTheUnknownCostsMoreAndObstaclesStay) {
  CostMapOptions options = test::thin_options();
  options.cross_unknown = true;
  options.unknown_cost = 3.0;
  const CostMap map = text_map({".?#"}, options);
  EXPECT_TRUE(map.traversable({1, 0}));
  EXPECT_FALSE(map.traversable({2, 0}));
  EXPECT_FLOAT_EQ(map.length_cost({1, 0}), 3.0F * map.length_cost({0, 0}));
  EXPECT_EQ(map.state({1, 0}), CellState::kUnknown);
}

TEST(CostMap, OutsideIsUnknownAndNotTraversable) {
  const CostMap map = text_map({"..."}, test::thin_options());
  EXPECT_EQ(map.state({-1, 0}), CellState::kUnknown);
  EXPECT_FALSE(map.traversable({3, 0}));
  EXPECT_FALSE(map.clear({0, 1}));
}

TEST(CostMap, WithoutObstaclesEverythingIsFar) {
  const core::Image<float> distance =
      distance_to_cells_m(core::Image<std::uint8_t>(5, 4), 0.1);
  for (const float value : distance.pixels()) EXPECT_GT(value, 1e5F);
}

}  // namespace
}  // namespace segsim::nav
