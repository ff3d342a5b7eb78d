#include "nav/planning/grid_planner.h"

#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <glm/geometric.hpp>

#include "tests/nav/text_map.h"

namespace segsim::nav {
namespace {

using test::random_map;
using test::text_map;

/// Bellman-Ford by sweeps: slow, simple, independent of queues and heuristics.
core::Image<double> brute_force(const CostMap& map, const Cell& start) {
  const int width = map.frame().width_cells, height = map.frame().height_cells;
  core::Image<double> cost(width, height, std::numeric_limits<double>::infinity());
  cost(start.x, start.y) = 0.0;
  for (bool changed = true; changed;) {
    changed = false;
    for (int j = 0; j < height; ++j) {
      for (int i = 0; i < width; ++i) {
        if (!std::isfinite(cost(i, j))) continue;
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dx = -1; dx <= 1; ++dx) {
            const Cell next(i + dx, j + dy);
            if ((dx == 0 && dy == 0) || !map.traversable(next)) continue;
            const double there =
                cost(i, j) +
                map.frame().resolution_m * std::hypot(dx, dy) * 0.5 *
                    static_cast<double>(map.length_cost({i, j}) + map.length_cost(next));
            if (there < cost(next.x, next.y) - 1e-9) {
              cost(next.x, next.y) = there;
              changed = true;
            }
          }
        }
      }
    }
  }
  return cost;
}

class RandomMaps : public testing::TestWithParam<int> {};

TEST_P(RandomMaps, AStarAndDijkstraAreOptimal) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const bool soft = GetParam() % 2 == 0;
  CostMapOptions options = test::thin_options();
  if (soft) {
    options.soft_distance_m = 0.3;
    options.soft_weight = 4.0;
  }
  const CostMap map = random_map(25, 0.3, seed, options);
  const auto start = nearest_traversable(map, {1, 1});
  if (!start) return;
  const core::Image<double> truth = brute_force(map, *start);
  const auto field = geodesic_field(map, *start);
  ASSERT_TRUE(field);
  for (int j = 0; j < 25; ++j) {
    for (int i = 0; i < 25; ++i) {
      ASSERT_EQ(field->reachable({i, j}), std::isfinite(truth(i, j)));
      const auto cells = astar_cells(map, *start, {i, j});
      ASSERT_EQ(cells.has_value(), std::isfinite(truth(i, j)));
      if (!cells) continue;
      EXPECT_NEAR(static_cast<double>(field->cost_m(i, j)), truth(i, j), 1e-4);
      EXPECT_NEAR(chain_cost_m(map, *cells), truth(i, j), 2e-3 * (1.0 + truth(i, j)));
      EXPECT_EQ(cells->front(), *start);
      EXPECT_EQ(cells->back(), Cell(i, j));
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, RandomMaps, testing::Range(1, 7));

TEST(GeodesicField, TheNearestOfManyIsFoundWithoutTheFartherOnes) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const CostMap map = random_map(40, 0.2, seed, test::thin_options());
    const auto start = nearest_traversable(map, {20, 20});
    if (!start) continue;
    const GeodesicField all = *geodesic_field(map, *start);
    const auto wanted = [&](const Cell& cell) {
      return (cell.x * 7 + cell.y * 3 + seed) % 11 == 0;
    };
    std::optional<Cell> truth;
    const CellBox box = map.frame().box();
    for (int j = box.low.y; j <= box.high.y; ++j) {
      for (int i = box.low.x; i <= box.high.x; ++i) {
        if (!all.reachable({i, j}) || !wanted({i, j})) continue;
        if (!truth || all.cost_m(i, j) < all.cost_m(truth->x, truth->y)) truth = Cell(i, j);
      }
    }
    const GeodesicField field = *geodesic_field(map, *start);
    EXPECT_EQ(field.nearest_of(wanted), truth) << seed;
    EXPECT_LE(field.settled_below_m(), all.settled_below_m());
    EXPECT_EQ(geodesic_field(map, *start)->nearest_of([](const Cell&) { return false; }),
              std::nullopt);
  }
}

TEST(PlanPath, IsStraightInTheOpenAndShorterThanTheChain) {
  const CostMap map =
      text_map(std::vector<std::string>(30, std::string(40, '.')), test::thin_options());
  const auto path = plan_path(map, {0.25, 0.25}, {3.75, 1.25});
  ASSERT_TRUE(path);
  EXPECT_EQ(path->points_m.size(), 2U);
  EXPECT_NEAR(path->length_m, std::hypot(3.5, 1.0), 1e-9);
  EXPECT_LT(path->length_m, path->cost_m);
}

TEST(PlanPath, EverySegmentIsTraversable) {
  for (std::uint64_t seed = 1; seed < 30; ++seed) {
    const CostMap map = random_map(30, 0.2, seed, test::thin_options());
    if (!map.traversable({0, 0}) || !map.traversable({29, 29})) continue;
    const auto path =
        plan_path(map, map.frame().center_m({0, 0}), map.frame().center_m({29, 29}));
    if (!path) continue;
    for (std::size_t k = 1; k < path->points_m.size(); ++k) {
      // Steps between diagonal neighbours may touch a corner; longer segments may not.
      if (glm::distance(path->points_m[k - 1], path->points_m[k]) < 0.15) continue;
      EXPECT_TRUE(segment_traversable(map, path->points_m[k - 1], path->points_m[k]));
    }
  }
}

TEST(PlanPath, EscapesFromInflationThroughFreeCellsOnly) {
  CostMapOptions options = test::thin_options();
  options.robot_radius_m = 0.25;
  const CostMap map =
      text_map({"...............", "...............", "...............", "...............",
                "###############", "...............", "...............", "..............."},
               options);
  // (7, 4) lies next to the wall: the way out is up, not through it.
  const auto out = nearest_traversable(map, {7, 4});
  ASSERT_TRUE(out);
  EXPECT_EQ(*out, Cell(7, 6));
  const auto path = plan_path(map, map.frame().center_m({7, 4}), map.frame().center_m({1, 7}));
  ASSERT_TRUE(path);
  EXPECT_EQ(map.frame().cell_at(path->points_m.front()), Cell(7, 4));
}

TEST(PlanPath, SaysWhenThereIsNoWay) {
  const CostMap map = text_map({"...#...", "...#...", "...#..."}, test::thin_options());
  EXPECT_FALSE(plan_path(map, map.frame().center_m({0, 0}), map.frame().center_m({6, 2})));
  EXPECT_FALSE(plan_path(map, map.frame().center_m({0, 0}), map.frame().center_m({3, 0})));
  EXPECT_FALSE(plan_path(map, {-5.0, -5.0}, map.frame().center_m({0, 0})));
}

}  // namespace
}  // namespace segsim::nav
