#include "nav/mapping/obstacle_map.h"

#include <numeric>

#include <gtest/gtest.h>

#include "tests/nav/box_world.h"
#include "tests/nav/test_view.h"

namespace segsim::nav {
namespace {

using test::kNan;
using test::kPi;
using test::TestView;

VlfmRules only_published(Quirk quirk) {
  VlfmRules rules;
  rules.set(quirk, Rule::kVlfm);
  return rules;
}

int count_of(const GridLayer<std::uint8_t>& cells) {
  int count = 0;
  for (int j = 0; j < cells.height_cells(); ++j) {
    count = std::accumulate(cells.row(j), cells.row(j) + cells.width_cells(), count);
  }
  return count;
}

/// Whether everything explored is navigable.
bool explored_is_navigable(const ObstacleMap& map) {
  for (int j = 0; j < map.frame().height_cells; ++j) {
    for (int i = 0; i < map.frame().width_cells; ++i) {
      if (map.explored()(i, j) > map.navigable()(i, j)) return false;
    }
  }
  return true;
}

/// A camera at 0.88 m in front of a wall `distance_m` ahead, or with nothing there.
void look_at_wall(TestView& view, float distance_m) {
  std::fill(view.depth.pixels().begin(), view.depth.pixels().end(), distance_m);
}

TEST(ObstacleMap, KernelIsTheDiameterInCellsMadeOdd) {
  EXPECT_EQ(navigable_kernel_cells(0.18, 0.05), 7);  // 7.2
  EXPECT_EQ(navigable_kernel_cells(0.20, 0.05), 9);  // 8
  EXPECT_EQ(navigable_kernel_cells(0.334, 0.05), 13);
}

TEST(ObstacleMap, PublishedGridHasTheStartInTheMiddleOfItsCell) {
  ObstacleMap map({}, VlfmRules(Rule::kVlfm));
  TestView view;
  map.update(view.observation);
  EXPECT_EQ(map.frame().width_cells, 1000);
  EXPECT_EQ(map.frame().cell_at({0.0, 0.0}), Cell(500, 500));
  EXPECT_EQ(map.frame().cell_at({0.024, -0.024}), Cell(500, 500));
  EXPECT_EQ(map.frame().cell_at({0.026, 1.0}), Cell(501, 520));
  EXPECT_NEAR(map.frame().center_m({500, 500}).x, 0.0, 1e-9);
}

TEST(ObstacleMap, OnlyTheBandAndTheRangeCount) {
  // 0.61 .. 0.88 m at 2 m: slopes -0.135 .. 0 of a level camera at 0.88 m.
  VlfmRules rules(Rule::kVlfm);
  ObstacleMap map({}, rules);
  TestView view({}, 2.0F, 0.88, 160, 120);
  map.update(view.observation);
  EXPECT_EQ(map.occupied()(500 + 40, 500), 1);
  EXPECT_EQ(map.occupied()(500 + 39, 500), 0);
  const double half = 2.0 * std::tan(39.5 * kPi / 180.0);
  // One row of cells across the view.
  EXPECT_NEAR(count_of(map.occupied()), 2.0 * half / 0.05, 4.0);
  // The same wall below the band, and one at the end of the range.
  ObstacleMap low({}, rules);
  TestView from_above({}, 2.0F, 0.40);  // Everything up to 0.40 + 2 tan(32) = 1.6 m.
  ObstacleMapOptions floor_only;
  floor_only.band_min_m = 1.7;
  floor_only.band_max_m = 2.0;
  ObstacleMap none(floor_only, rules);
  none.update(from_above.observation);
  EXPECT_EQ(count_of(none.occupied()), 0);
  TestView far({}, 5.0F);
  low.update(far.observation);
  EXPECT_EQ(count_of(low.occupied()), 0);  // Depth < 5.0 counts.
}

TEST(ObstacleMap, ObstaclesStayOrAreCleared) {  // Q4
  for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
    VlfmRules rules;
    rules.set(Quirk::kObstaclesStay, rule);
    ObstacleMap map({}, rules);
    TestView view({}, 2.0F, 0.88, 160, 120);
    for (int k = 0; k < 2; ++k) map.update(view.observation);
    const auto at = [&](double x_m) {
      const Cell cell = map.frame().cell_at({x_m, 0.0});
      return map.occupied()(cell.x, cell.y);
    };
    EXPECT_EQ(at(2.01), 1);
    look_at_wall(view, 4.0F);  // It went away.
    for (int k = 0; k < 12; ++k) map.update(view.observation);
    EXPECT_EQ(at(4.01), 1);
    EXPECT_EQ(at(2.01), rule == Rule::kVlfm ? 1 : 0);
  }
}

TEST(ObstacleMap, ZeroDepthIsFarOrUnknown) {  // Q8
  // A hole in a wall, wider than the filter fills.
  TestView view({}, 2.0F, 0.88, 160, 120);
  for (int y = 30; y < 90; ++y) {
    for (int x = 50; x < 110; ++x) view.depth(x, y) = kNan;
  }
  core::Image<float> published, fixed;
  clean_depth_m(view.depth, only_published(Quirk::kZeroDepth), {}, published);
  clean_depth_m(view.depth, VlfmRules(), {}, fixed);
  EXPECT_NEAR(published(80, 60), 5.0F, 1e-5F);  // Far.
  EXPECT_TRUE(std::isnan(fixed(80, 60)));
  EXPECT_NEAR(published(20, 60), 2.0F, 1e-5F);
  EXPECT_EQ(fixed(20, 60), 2.0F);
}

TEST(ObstacleMap, SmallHolesAreFilledFromAroundThem) {
  TestView view({}, 2.0F, 0.88, 160, 120);
  for (int y = 58; y < 62; ++y) {
    for (int x = 78; x < 82; ++x) view.depth(x, y) = 0.0F;
  }
  core::Image<float> cleaned;
  clean_depth_m(view.depth, VlfmRules(Rule::kVlfm), {}, cleaned);
  for (const float depth : cleaned.pixels()) ASSERT_NEAR(depth, 2.0F, 1e-4F);
}

TEST(ObstacleMap, InferredDepthOffset) {  // Q13
  EXPECT_NEAR(normalised_inferred(2.75, VlfmRules(), {}), 0.5, 1e-12);
  EXPECT_NEAR(normalised_inferred(2.75, only_published(Quirk::kInferredOffset), {}),
              2.75 / 4.5, 1e-12);
}

TEST(ObstacleMap, ExploredAreaGrowsInFrontAndStaysNavigable) {
  ObstacleMap map;
  test::BoxWorld world = test::four_rooms();
  test::SimulationOptions options;
  options.camera = core::CameraIntrinsics::from_fov(160, 120, 1.3788);
  options.mast_m = 0.88;
  test::Simulation simulation(world, {5.0, 4.0, 0.0}, options);
  for (int k = 0; k < 3; ++k) {
    map.update(simulation.observe());
    simulation.step({0.0, 0.0});
  }
  EXPECT_GT(count_of(map.explored()), 300);
  EXPECT_TRUE(explored_is_navigable(map));
  const Cell behind = map.frame().cell_at({2.0, 4.0});
  EXPECT_EQ(map.explored()(behind.x, behind.y), 0);
  EXPECT_FALSE(map.frontiers().empty());
}

/// Something was felt on either side of the robot, so that the inflation encloses it.
TEST(ObstacleMap, EnclosedItExploresWhatItMeasured) {
  for (const bool measured : {false, true}) {
    ObstacleMapOptions options;
    options.robot_radius_m = 0.33;
    options.measured_where_enclosed = measured;
    ObstacleMap map(options);
    test::SimulationOptions simulated;
    simulated.camera = core::CameraIntrinsics::from_fov(160, 120, 1.3788);
    simulated.mast_m = 0.88;
    test::Simulation ahead(test::four_rooms(), {5.0, 4.0, 0.0}, simulated);
    map.update(ahead.observe());
    map.mark_blocked_disc({5.0, 4.28}, 0.05);
    map.mark_blocked_disc({5.0, 3.72}, 0.05);
    const Cell robot = map.frame().cell_at({5.0, 4.0});
    ASSERT_EQ(map.navigable()(robot.x, robot.y), 0);
    const int before = count_of(map.explored());
    test::Simulation behind(test::four_rooms(), {5.0, 4.0, kPi}, simulated);
    for (int k = 0; k < 2; ++k) map.update(behind.observe());
    EXPECT_EQ(count_of(map.explored()) > before + 100, measured);
    EXPECT_TRUE(explored_is_navigable(map));
  }
}

TEST(ObstacleMap, OneComponentOrAll) {  // Q10
  // Two views of open floor, 14 m apart; with Q3 fixed each reveals its sector.
  for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
    VlfmRules rules;
    rules.set(Quirk::kOneComponent, rule);
    ObstacleMap map({}, rules);
    TestView view({}, kNan);
    map.update(view.observation);
    view.move_to({14.0, 0.0, 0.0});
    map.update(view.observation);
    const Cell first = map.frame().cell_at({2.0, 0.0}), now = map.frame().cell_at({16.0, 0.0});
    EXPECT_EQ(map.explored()(now.x, now.y), 1);
    EXPECT_EQ(map.explored()(first.x, first.y), rule == Rule::kVlfm ? 0 : 1);
  }
}

TEST(ObstacleMap, BeyondTheMap) {  // Q9
  TestView view({}, 2.0F, 0.88, 160, 120);
  ObstacleMap published({}, VlfmRules(Rule::kVlfm));
  published.update(view.observation);
  view.move_to({-24.0, 0.0, kPi});  // The wall at -26 m wraps to the other side.
  published.update(view.observation);
  EXPECT_FALSE(published.exhausted());
  EXPECT_EQ(published.occupied()(1000 + 500 - 520, 500), 1);
  view.move_to({26.0, 0.0, 0.0});  // Beyond the last index.
  published.update(view.observation);
  EXPECT_TRUE(published.exhausted());

  ObstacleMap growing;
  view.move_to({0.0, 0.0, 0.0});
  growing.update(view.observation);
  view.move_to({26.0, 40.0, 0.0});
  growing.update(view.observation);
  EXPECT_FALSE(growing.exhausted());
  EXPECT_GT(growing.frame().height_cells, 900);
  view.move_to({1e5, 0.0, 0.0});
  growing.update(view.observation);
  EXPECT_TRUE(growing.exhausted());
  EXPECT_LT(growing.frame().width_cells, 4001);
}

TEST(ObstacleMap, DegenerateDepth) {
  for (const float depth :
       {kNan, std::numeric_limits<float>::infinity(), 0.0F, -3.0F, 1e30F}) {
    for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
      TestView view({}, depth);
      ObstacleMap map({}, VlfmRules(rule));
      map.update(view.observation);
      EXPECT_EQ(count_of(map.occupied()), 0);
      (void)map.frontiers();
    }
  }
}

TEST(ObstacleMap, WideImagesGiveTheSameWall) {
  for (const int scale : {1, 2, 4}) {  // 640 px and more are thinned out.
    ObstacleMap map;
    TestView view({}, 2.0F, 0.88, 320 * scale, 240 * scale);
    for (int k = 0; k < 2; ++k) map.update(view.observation);
    for (const double y_m : {-1.4, -0.5, 0.0, 0.5, 1.4}) {
      const Cell cell = map.frame().cell_at({2.01, y_m});
      EXPECT_EQ(map.occupied()(cell.x, cell.y), 1) << scale << " " << y_m;
      EXPECT_EQ(map.occupied()(cell.x - 2, cell.y), 0) << scale << " " << y_m;
    }
  }
}

TEST(ObstacleMap, FeltObstaclesCount) {
  ObstacleMap map;
  TestView view({}, kNan);
  map.update(view.observation);
  map.mark_blocked_disc({1.0, 0.0}, 0.1);
  const Cell cell = map.frame().cell_at({1.0, 0.0});
  EXPECT_EQ(map.occupied()(cell.x, cell.y), 1);
  EXPECT_EQ(map.navigable()(cell.x + 3, cell.y), 0);
  map.update(view.observation);
  EXPECT_EQ(map.occupied()(cell.x, cell.y), 1);
  map.forget_blocked();
  map.update(view.observation);
  EXPECT_EQ(map.occupied()(cell.x, cell.y), 0);
}

}  // namespace
}  // namespace segsim::nav
