/// What is updated where something changed ends like what is computed from scratch, bit for
/// bit, over random sequences and over searches.

#include <cmath>
#include <queue>

#include <gmock/gmock.h>

#include "nav/frontier/frontiers.h"
#include "nav/mapping/obstacle_map.h"
#include "tests/nav/box_world.h"
#include "tests/nav/known_frontiers.h"
#include "tests/nav/text_map.h"

namespace segsim::nav {
namespace {

using namespace test;

/// Equal over the active part; a map that grew may have a larger frame around it.
void expect_equal(const CostMap& a, const CostMap& b) {
  const Cell shift = b.frame().lattice() - a.frame().lattice();
  ASSERT_EQ(a.active().low, b.active().low + shift);
  ASSERT_EQ(a.active().high, b.active().high + shift);
  for (int j = b.active().low.y; j <= b.active().high.y; ++j) {
    for (int i = b.active().low.x; i <= b.active().high.x; ++i) {
      const Cell in_b(i, j), in_a = in_b + shift;
      ASSERT_EQ(a.state(in_a), b.state(in_b));
      ASSERT_EQ(a.clear(in_a), b.clear(in_b));
      ASSERT_EQ(a.traversable(in_a), b.traversable(in_b)) << i << " " << j;
      ASSERT_EQ(a.length_cost(in_a), b.length_cost(in_b));
      ASSERT_EQ(a.clearance_m(in_a), b.clearance_m(in_b));
      ASSERT_EQ(a.mast_clearance_m(in_a), b.mast_clearance_m(in_b));
    }
  }
}

TEST(IncrementalMaps, ClearanceIsThatOfTheDistanceTransformUpToTheReach) {
  core::RandomStream random(3, "clearance");
  core::Image<std::uint8_t> sources(70, 50);
  ClearanceField field;
  field.reset(70, 50, 12);
  for (int round = 0; round < 40; ++round) {
    CellBox changed;
    for (int k = 0; k < 6; ++k) {
      const Cell cell(static_cast<int>(random.index(70)), static_cast<int>(random.index(50)));
      sources(cell.x, cell.y) = random.chance(0.4) ? 1 : 0;
      changed.add(cell);
    }
    field.update(sources, changed);
    const core::Image<float> truth = distance_to_cells_m(sources, 1.0);
    for (int j = 0; j < 50; ++j) {
      for (int i = 0; i < 70; ++i) {
        if (truth(i, j) <= 12.0F) {
          ASSERT_EQ(std::sqrt(static_cast<float>(field.squared_cells(i, j))), truth(i, j));
        } else {
          ASSERT_EQ(field.squared_cells(i, j), field.beyond());
        }
      }
    }
  }
}

/// Random cells change in random boxes; small unknown pockets come, join, and go.
TEST(IncrementalMaps, CostMapAfterRandomChanges) {
  for (const bool cross : {false, true}) {
    core::RandomStream random(cross ? 5 : 6, "cost");
    CostMapOptions options;
    options.robot_radius_m = 0.12;
    options.cross_unknown = cross;
    options.fill_pocket_m2 = 0.05;
    GridFrame frame;
    frame.width_cells = 90;
    frame.height_cells = 80;
    core::Image<std::uint8_t> occupied(90, 80), explored(90, 80), mast(90, 80);
    CellBox active{{30, 30}, {50, 50}};
    CostMap map;
    map.update(frame, occupied, explored, mast, active, frame.box(), options);
    for (int round = 0; round < 120; ++round) {
      if (round % 10 == 9) {
        active.low -=
            Cell(static_cast<int>(random.index(3)), static_cast<int>(random.index(3)));
        active.high += Cell(static_cast<int>(random.index(3)), 1);
        active = active.clipped_to({{0, 0}, {89, 79}});
      }
      const Cell size(2 + static_cast<int>(random.index(14)),
                      2 + static_cast<int>(random.index(14)));
      const Cell low = active.low + Cell(static_cast<int>(random.index(20)),
                                         static_cast<int>(random.index(20)));
      const CellBox box = CellBox{low, low + size}.clipped_to(active);
      const double hits = random.uniform(0.0, 0.05), seen = random.uniform(0.4, 1.0);
      for (int j = box.low.y; j <= box.high.y; ++j) {
        for (int i = box.low.x; i <= box.high.x; ++i) {
          occupied(i, j) = random.chance(hits) ? 1 : 0;
          explored(i, j) = random.chance(seen) ? 1 : 0;
          mast(i, j) = random.chance(0.5 * hits) ? 1 : 0;
        }
      }
      map.update(frame, occupied, explored, mast, active, box, options);
      CostMap scratch;
      scratch.update(frame, occupied, explored, mast, active, frame.box(), options);
      ASSERT_NO_FATAL_FAILURE(expect_equal(map, scratch)) << round;
    }
  }
}

/// Dijkstra with a heap over the whole map.
core::Image<float> dijkstra(const CostMap& map, const Cell& start) {
  core::Image<float> cost(map.frame().width_cells, map.frame().height_cells,
                          std::numeric_limits<float>::infinity());
  using Entry = std::pair<float, int>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  const auto resolution = static_cast<float>(map.frame().resolution_m);
  cost(start.x, start.y) = 0.0F;
  open.emplace(0.0F, start.y * cost.width_px() + start.x);
  while (!open.empty()) {
    const auto [here, index] = open.top();
    open.pop();
    const Cell at(index % cost.width_px(), index / cost.width_px());
    if (here > cost(at.x, at.y)) continue;
    for (int n = 0; n < 9; ++n) {
      const Cell next(at.x + n % 3 - 1, at.y + n / 3 - 1);
      if (n == 4 || !map.traversable(next)) continue;
      const float length = n % 2 == 0 ? 1.41421356F : 1.0F;
      const float there =
          here + resolution * length * 0.5F * (map.length_cost(at) + map.length_cost(next));
      if (there >= cost(next.x, next.y)) continue;
      cost(next.x, next.y) = there;
      open.emplace(there, next.y * cost.width_px() + next.x);
    }
  }
  return cost;
}

/// A whole exploration: after every tick everything is compared with a map built anew.
TEST(IncrementalMaps, AlongAnExploration) {
  SimulationOptions camera;
  camera.camera = core::CameraIntrinsics::from_fov(80, 60, 1.3788);
  camera.mast_m = 1.1;
  Simulation simulation(four_rooms(), {1.0, 2.6, 0.0}, camera);
  OccupancyMap occupancy;
  VlfmRules rules;
  ObstacleMapOptions options;
  options.robot_radius_m = 0.33;
  options.band_min_m = 0.10;
  options.band_max_m = 0.60;
  options.growth.start_extent_m = 12.0;
  ObstacleMap obstacles(options, rules);
  CostMap by_odds, by_layers;
  GeodesicField field;
  for (int tick = 0; tick < 60; ++tick) {
    const core::Observation& observation = simulation.observe();
    occupancy.integrate(observation);
    obstacles.update(observation);
    by_odds.update(occupancy, occupancy.take_changed(), {});
    CostMapOptions crossing;
    crossing.cross_unknown = true;
    by_layers.update(obstacles.frame(), obstacles.occupied(), obstacles.explored(),
                     obstacles.mast(), obstacles.observed(), obstacles.take_changed(),
                     crossing);
    simulation.step({tick % 12 < 4 ? 0.4 : 0.0, 0.7});
    if (tick % 6 != 5) continue;
    CostMap scratch;
    scratch.build(occupancy, {});
    ASSERT_NO_FATAL_FAILURE(expect_equal(by_odds, scratch)) << tick;
    CostMap layers;
    layers.update(obstacles.frame(), obstacles.occupied(), obstacles.explored(),
                  obstacles.mast(), obstacles.observed(), obstacles.frame().box(), crossing);
    ASSERT_NO_FATAL_FAILURE(expect_equal(by_layers, layers)) << tick;

    // Distances, asked for in any order, are Dijkstra's; a selector that asks for as few as it
    // needs chooses as one that knows all.
    const Cell robot = by_odds.frame().cell_at({simulation.pose().x_m, simulation.pose().y_m});
    ASSERT_TRUE(field.begin(by_odds, robot));
    std::vector<Frontier> lazily = find_reachable_frontiers(by_odds, field, {});
    FrontierSelector few, all;
    const auto chosen = few.select(lazily, field);
    std::vector<Frontier> known = known_frontiers(by_odds, field);
    const auto expected = all.select(known);
    ASSERT_EQ(chosen.has_value(), expected.has_value());
    if (chosen) {
      EXPECT_EQ(chosen->waypoint, expected->waypoint);
    }
    const core::Image<float> truth = dijkstra(by_odds, field.start());
    for (int k = 0; k < 400; ++k) {
      const int i = (k * 7919) % truth.width_px(), j = (k * 104'729) % truth.height_px();
      ASSERT_EQ(field.cost_m(i, j), truth(i, j));
      ASSERT_EQ(field.reachable({i, j}), std::isfinite(truth(i, j)));
    }
  }
}

}  // namespace
}  // namespace segsim::nav
