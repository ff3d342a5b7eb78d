#include "nav/mapping/contour_frontiers.h"

#include <gtest/gtest.h>

namespace segsim::nav {
namespace {

struct Scene {
  GridFrame frame{0.05, {0.0, 0.0}, 200, 200};
  core::Image<std::uint8_t> explored{200, 200, 0}, navigable{200, 200, 1};
  void explore(int i0, int j0, int i1, int j1, std::uint8_t value = 1) {
    for (int j = j0; j <= j1; ++j) {
      for (int i = i0; i <= i1; ++i) explored(i, j) = value;
    }
  }
  void wall(int i0, int j0, int i1, int j1) {
    for (int j = j0; j <= j1; ++j) {
      for (int i = i0; i <= i1; ++i) navigable(i, j) = explored(i, j) = 0;
    }
  }
  [[nodiscard]] std::vector<ContourFrontier> find(double pocket_m2 = 1.5) const {
    ContourFrontierOptions options;
    options.min_pocket_m2 = pocket_m2;
    return find_contour_frontiers(frame, explored, navigable, options);
  }
};

TEST(ContourFrontiers, NothingExploredNothingFound) { EXPECT_TRUE(Scene().find().empty()); }

TEST(ContourFrontiers, MiddleByArcLengthNotByCount) {
  // Ten straight steps and five diagonal ones: half of 10 + 5 sqrt(2) = 8.54.
  std::vector<Cell> cells;
  for (int k = 0; k <= 10; ++k) cells.emplace_back(k, 0);
  for (int k = 1; k <= 5; ++k) cells.emplace_back(10 + k, k);
  EXPECT_NEAR(middle_along(cells).x, 0.5 * (10.0 + 5.0 * std::sqrt(2.0)), 1e-9);
  EXPECT_NEAR(middle_along(cells).y, 0.0, 1e-9);
  EXPECT_EQ(middle_along({Cell(3, 4)}), glm::dvec2(3.0, 4.0));
}

TEST(ContourFrontiers, OneOpenSideOfARoom) {
  // A room with walls on three sides, open to the right.
  Scene scene;
  scene.explore(50, 50, 100, 100);
  scene.wall(40, 40, 110, 49);
  scene.wall(40, 101, 110, 110);
  scene.wall(40, 40, 49, 110);
  const auto frontiers = scene.find();
  ASSERT_EQ(frontiers.size(), 1U);
  // Explored is dilated by two cells: the open side lies at i = 102, from j = 50 to 100.
  EXPECT_NEAR(frontiers[0].waypoint_m.x, (102 + 0.5) * 0.05, 1e-9);
  EXPECT_NEAR(frontiers[0].waypoint_m.y, (75 + 0.5) * 0.05, 0.051);
  EXPECT_EQ(frontiers[0].cells.size(), 51U);
}

TEST(ContourFrontiers, ARunAcrossTheOutlinesStartIsJoined) {
  // Wholly in the open: one closed frontier, however the outline begins.
  Scene scene;
  scene.explore(80, 80, 120, 120);
  const auto frontiers = scene.find();
  ASSERT_EQ(frontiers.size(), 1U);
  EXPECT_EQ(frontiers[0].cells.size(), 4U * 44U);  // 45 x 45 cells after dilation.
}

TEST(ContourFrontiers, SmallPocketsCountAsExplored) {
  // A pocket of 24 x 24 cells: 576 cells2 of outline 529 < 600; one of 31 x 31 is larger.
  for (const int side : {24, 34}) {
    Scene scene;
    scene.explore(20, 20, 180, 180);
    scene.wall(10, 10, 190, 19);
    scene.wall(10, 181, 190, 190);
    scene.wall(10, 10, 19, 190);
    scene.wall(181, 10, 190, 190);
    scene.explore(80, 80, 80 + side - 1, 80 + side - 1, 0);
    // The dilation of 5 takes two cells off each side.
    const double outline_cells2 = (side - 5.0) * (side - 5.0);
    EXPECT_EQ(scene.find().empty(), outline_cells2 < 600.0) << side;
    EXPECT_FALSE(scene.find(0.1).empty());
  }
}

TEST(ContourFrontiers, ObstaclesAreNoFrontiers) {
  Scene scene;
  scene.explore(20, 20, 180, 180);
  scene.wall(10, 10, 190, 19);
  scene.wall(10, 181, 190, 190);
  scene.wall(10, 10, 19, 190);
  scene.wall(181, 10, 190, 190);
  scene.wall(90, 90, 130, 130);
  EXPECT_TRUE(scene.find().empty());
}

}  // namespace
}  // namespace segsim::nav
