#include "nav/frontier/frontiers.h"

#include <gmock/gmock.h>

#include "tests/nav/known_frontiers.h"
#include "tests/nav/text_map.h"

namespace segsim::nav {
namespace {

using test::text_map;

std::vector<Frontier> frontiers_of(const CostMap& map, const Cell& robot,
                                   const FrontierOptions& options = {}) {
  const auto field = geodesic_field(map, robot);
  return field ? test::known_frontiers(map, *field, options) : std::vector<Frontier>{};
}

TEST(Frontiers, MiddleOfTheOpenSide) {
  const CostMap map = text_map({"###########", "#.....?????", "#.....?????", "#.....?????",
                                "#.....?????", "#.....?????", "###########"},
                               test::thin_options());
  const auto frontiers = frontiers_of(map, {2, 3});
  ASSERT_EQ(frontiers.size(), 1U);
  EXPECT_EQ(frontiers[0].waypoint, Cell(5, 3));
  EXPECT_NEAR(frontiers[0].length_m, 0.5, 1e-9);
  EXPECT_NEAR(frontiers[0].distance_m, 0.3, 1e-5);
  EXPECT_GT(frontiers[0].outward.x, 0.99);
}

TEST(Frontiers, UnreachableAndShortOnesDoNotCount) {
  FrontierOptions options;
  options.min_length_m = 0.25;
  const CostMap map =
      text_map({"############", "#....#...???", "#....#...???", "#....#...???", "#....#######",
                "#....??#####", "#....??#####", "#....#######", "############"},
               test::thin_options());
  // On the right side of the wall nothing is reachable; the gap of two cells is too short,
  // except that its corner neighbours touch the unknown too.
  const auto all = frontiers_of(map, {2, 2});
  ASSERT_EQ(all.size(), 1U);
  EXPECT_EQ(all[0].waypoint.x, 4);
  options.min_length_m = 0.55;
  EXPECT_TRUE(frontiers_of(map, {2, 2}, options).empty());
}

TEST(Frontiers, ClosedRoomHasNone) {
  const CostMap map = text_map(
      {"??????????", "?########?", "?#......#?", "?#......#?", "?########?", "??????????"},
      test::thin_options());
  EXPECT_TRUE(frontiers_of(map, {3, 2}).empty());
}

TEST(Frontiers, UnknownTooNearToObstaclesDoesNotCount) {
  // A slit of two cells between walls: seen as open by a thin robot, closed for a wide one.
  const std::vector<std::string> lines{"###########", "#.....#####", "#.....?????",
                                       "#.....?????", "#.....#####", "###########"};
  EXPECT_EQ(frontiers_of(text_map(lines, test::thin_options()), {2, 2}).size(), 1U);
  CostMapOptions wide = test::thin_options();
  wide.robot_radius_m = 0.18;
  EXPECT_TRUE(frontiers_of(text_map(lines, wide), {2, 2}).empty());
}

TEST(Frontiers, LongRunsAreCutAndEveryPartHasItsWaypoint) {
  const CostMap map =
      text_map({std::string(80, '?'), std::string(80, '.'), std::string(80, '.')},
               test::thin_options());
  FrontierOptions options;
  options.max_length_m = 2.0;
  const auto frontiers = frontiers_of(map, {5, 0}, options);
  ASSERT_GE(frontiers.size(), 4U);
  double length_m = 0.0;
  for (const Frontier& frontier : frontiers) length_m += frontier.length_m;
  EXPECT_NEAR(length_m, 7.8, 0.21);
}

Frontier at(double x, double distance_m, double length_m) {
  Frontier frontier;
  frontier.waypoint_m = {x, 0.0};
  frontier.distance_m = distance_m;
  frontier.length_m = length_m;
  return frontier;
}

TEST(FrontierSelector, NearestWithSizeBonus) {
  FrontierSelector selector;
  std::vector<Frontier> frontiers{at(0, 3.0, 0.5), at(5, 2.0, 0.5), at(9, 2.4, 2.0)};
  EXPECT_EQ(selector.select(frontiers)->waypoint_m.x, 9.0);  // 2.4 - 1.0 < 2.0 - 0.25.
}

TEST(FrontierSelector, SticksUntilAnotherIsClearlyBetter) {
  FrontierSelector selector;
  std::vector<Frontier> frontiers{at(0, 2.0, 0.5), at(5, 2.5, 0.5)};
  EXPECT_EQ(selector.select(frontiers)->waypoint_m.x, 0.0);
  frontiers = {at(0.3, 2.9, 0.5), at(5, 2.0, 0.5)};
  EXPECT_EQ(selector.select(frontiers)->waypoint_m.x, 0.3);
  frontiers = {at(0.3, 3.3, 0.5), at(5, 2.0, 0.5)};
  EXPECT_EQ(selector.select(frontiers)->waypoint_m.x, 5.0);
}

TEST(FrontierSelector, BlacklistVetoesANeighbourhood) {
  FrontierSelector selector;
  std::vector<Frontier> frontiers{at(0, 1.0, 0.5), at(5, 2.5, 0.5)};
  selector.blacklist({0.2, 0.0});
  EXPECT_EQ(selector.select(frontiers)->waypoint_m.x, 5.0);
  selector.blacklist({5.0, 0.0});
  EXPECT_FALSE(selector.select(frontiers));
  selector.clear_blacklist();
  EXPECT_TRUE(selector.select(frontiers));
}

TEST(FrontierSelector, AScorerReplacesTheDistance) {
  FrontierSelector selector({},
                            [](const Frontier& frontier) { return frontier.waypoint_m.x; });
  std::vector<Frontier> frontiers{at(0, 1.0, 0.5), at(5, 9.0, 0.5)};
  EXPECT_EQ(selector.select(frontiers)->waypoint_m.x, 5.0);
}

}  // namespace
}  // namespace segsim::nav
