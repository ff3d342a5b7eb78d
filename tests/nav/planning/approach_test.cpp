#include "nav/planning/approach.h"

#include <cmath>

#include <gmock/gmock.h>
#include <glm/geometric.hpp>

#include "tests/nav/text_map.h"

namespace segsim::nav {
namespace {

using test::text_map;

MappedObject object_at(double x, double y, double low_z, double high_z) {
  MappedObject object;
  object.center_m = {x, y, 0.5 * (low_z + high_z)};
  object.low_m = {x - 0.1, y - 0.1, low_z};
  object.high_m = {x + 0.1, y + 0.1, high_z};
  for (const double dx : {-0.08, 0.0, 0.08}) {
    object.cloud_m.emplace_back(x + dx, y, 0.5 * (low_z + high_z));
  }
  return object;
}

TEST(ViewDistance, IsWhereTheLowestRayMeetsTheMiddleOfTheCloud) {
  // The middle point of the cloud lies 0.08 m behind the nearest one.
  core::Observation observation;
  observation.intrinsics = core::CameraIntrinsics::from_fov(256, 192, 1.3788);
  observation.T_robot_camera = core::mast_camera(1.1, 0.0);
  const double tan_down = 96.0 / observation.intrinsics.fy_px;
  EXPECT_NEAR(view_distance_m(observation, object_at(3, 0, 0.0, 0.6)),
              0.8 / (0.95 * tan_down) - 0.08, 1e-6);
  EXPECT_EQ(view_distance_m(observation, object_at(3, 0, 1.0, 1.6)), 0.0);
  observation.T_robot_camera = core::mast_camera(1.1, 0.4);
  EXPECT_NEAR(view_distance_m(observation, object_at(3, 0, 0.0, 0.6)),
              0.8 / (0.95 * std::tan(std::atan(tan_down) + 0.4)) - 0.08, 1e-6);
}

TEST(ChooseApproach, NearReachableAndInSight) {
  const CostMap map =
      text_map(std::vector<std::string>(60, std::string(60, '.')), test::thin_options());
  const auto field = geodesic_field(map, {5, 30});
  const MappedObject object = object_at(4.0, 3.0, 0.0, 0.8);
  const auto place = choose_approach(map, *field, object, 0.6, 1.0, 1.5);
  ASSERT_TRUE(place);
  EXPECT_TRUE(place->line_of_sight);
  EXPECT_GE(place->to_object_m, 0.6 - 1e-6);
  EXPECT_LE(place->to_object_m, 1.0 + 1e-6);
  EXPECT_LT(place->position_m.x, 4.0);  // On the robot's side.
}

TEST(ChooseApproach, WallsHideAndLowThingsDoNot) {
  std::vector<std::string> lines(11, std::string(30, '.'));
  for (std::string& line : lines) line[15] = '#';
  const CostMap low = text_map(lines, test::thin_options());
  EXPECT_TRUE(line_of_sight(low, {0.5, 0.5}, {2.5, 0.5}));
  core::Image<std::uint8_t> mast(30, 11);
  for (int j = 0; j < 11; ++j) mast(15, j) = 1;
  CostMap high;
  high.build(low.frame(), low.states(), mast, test::thin_options());
  EXPECT_FALSE(line_of_sight(high, {0.5, 0.5}, {2.5, 0.5}));
  EXPECT_TRUE(line_of_sight(high, {0.5, 0.5}, {1.55, 0.5}));  // The object is the wall.
}

TEST(ChooseApproach, PrefersTheSideWithoutACounter) {
  // A counter, lower than the mast, runs along x; the object stands beyond it.
  std::vector<std::string> lines(60, std::string(60, '.'));
  for (std::size_t i = 0; i < 50; ++i) lines[29][i] = lines[30][i] = '#';
  const CostMap map = text_map(lines, test::thin_options());
  const MappedObject object = object_at(3.0, 3.8, 0.0, 0.8);
  EXPECT_FALSE(open_floor(map, {3.0, 2.5}, {3.0, 3.8}));
  EXPECT_TRUE(line_of_sight(map, {3.0, 2.5}, {3.0, 3.8}));
  EXPECT_TRUE(open_floor(map, {3.0, 2.5}, {3.0, 3.3}));  // Within the skipped end.
  const auto field = geodesic_field(map, {30, 10});
  const auto place = choose_approach(map, *field, object, 0.6, 1.3, 1.5);
  ASSERT_TRUE(place);
  EXPECT_TRUE(place->open_floor);
  EXPECT_GT(place->position_m.y, 3.1);
}

TEST(ChooseApproach, FallsBackToTheNearestReachableCell) {
  std::vector<std::string> lines(11, std::string(60, '.'));
  for (std::string& line : lines) line[20] = '#';
  const CostMap map = text_map(lines, test::thin_options());
  const auto field = geodesic_field(map, {5, 5});
  const auto place =
      choose_approach(map, *field, object_at(5.05, 0.55, 0.0, 0.8), 0.6, 1.0, 1.5);
  ASSERT_TRUE(place);
  EXPECT_NEAR(place->position_m.x, 1.95, 1e-6);
  EXPECT_GT(place->to_object_m, 2.5);
}

TEST(ApproachRange, KeepsTheObjectInTheImageAndItselfInsideTheLimit) {
  const ApproachDistances distances;
  const double limit_m = distances.limit_m - distances.arrival_m;
  const ApproachRange tall = approach_range(distances, 0.0, false);
  EXPECT_EQ(tall.min_m, distances.min_m);
  EXPECT_EQ(tall.max_m, distances.max_m);
  EXPECT_EQ(tall.limit_m, limit_m);
  const ApproachRange low = approach_range(distances, 0.8, false);
  EXPECT_EQ(low.min_m, 0.8);
  EXPECT_EQ(low.max_m, 0.8 + distances.width_m);
  const ApproachRange afar = approach_range(distances, 0.8, true);
  EXPECT_EQ(afar.min_m, distances.far_look_m);
  // Never in the image: as far as is allowed, with room for a place.
  const ApproachRange never = approach_range(distances, 1e3, false);
  EXPECT_NEAR(never.min_m, limit_m - distances.sight_limit_m, 1e-12);
  EXPECT_LE(never.max_m, limit_m);
  EXPECT_GE(never.max_m - never.min_m, 0.2 - 1e-12);
}

TEST(SpreadPlaces, AreFarFromOneAnother) {
  const CostMap map =
      text_map(std::vector<std::string>(80, std::string(80, '.')), test::thin_options());
  const auto field = geodesic_field(map, {40, 40});
  const auto places = spread_places(map, *field, 3);
  ASSERT_EQ(places.size(), 3U);
  for (std::size_t a = 0; a < places.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) EXPECT_GT(glm::distance(places[a], places[b]), 4.0);
  }
}

}  // namespace
}  // namespace segsim::nav
