#include "nav/mapping/fog_of_war.h"

#include <numeric>

#include <gtest/gtest.h>

#include "tests/nav/test_view.h"

namespace segsim::nav {
namespace {

using test::kPi;

/// 20 m x 20 m around the origin, all navigable.
GridFrame square_frame() { return {0.05, {-10.0, -10.0}, 400, 400}; }

bool revealed(const CellWindow& window, const GridFrame& frame, const glm::dvec2& place_m) {
  const Cell cell = frame.cell_at(place_m) - window.low;
  return window.cells.contains(cell.x, cell.y) && window.cells(cell.x, cell.y) != 0;
}

int count_of(const CellWindow& window) {
  return std::accumulate(window.cells.pixels().begin(), window.cells.pixels().end(), 0);
}

VlfmRules published(Quirk quirk) {
  VlfmRules rules;
  rules.set(quirk, Rule::kVlfm);
  return rules;
}

TEST(FogOfWar, AnEmptyConeRevealsNothingOrAll) {  // Q3
  const GridFrame frame = square_frame();
  const core::Image<std::uint8_t> open(400, 400, 1);
  EXPECT_EQ(
      count_of(revealed_cells(frame, open, {0, 0}, 0.0, {}, published(Quirk::kEmptyCone))), 0);
  const CellWindow all = revealed_cells(frame, open, {0, 0}, 0.0, {}, VlfmRules());
  // 79 degrees of a disc of 5 m, drawn as 80 at most.
  EXPECT_NEAR(count_of(all) * 0.0025, 79.0 / 360.0 * kPi * 25.0, 0.6);
  EXPECT_TRUE(revealed(all, frame, {4.8, 0.0}));
  EXPECT_TRUE(revealed(all, frame, {3.0, 2.3}));
  EXPECT_FALSE(revealed(all, frame, {3.0, 2.8}));
  EXPECT_FALSE(revealed(all, frame, {-1.0, 0.0}));
}

TEST(FogOfWar, FollowsTheHeading) {
  const GridFrame frame = square_frame();
  const core::Image<std::uint8_t> open(400, 400, 1);
  const CellWindow left = revealed_cells(frame, open, {1, 1}, kPi / 2.0, {}, VlfmRules());
  EXPECT_TRUE(revealed(left, frame, {1.0, 5.0}));
  EXPECT_FALSE(revealed(left, frame, {5.0, 1.0}));
}

TEST(FogOfWar, NothingBehindAnObstacle) {
  const GridFrame frame = square_frame();
  for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
    core::Image<std::uint8_t> navigable(400, 400, 1);
    for (int j = 180; j < 220; ++j) {  // A block of 2 m, 2 m ahead.
      for (int i = 240; i < 250; ++i) navigable(i, j) = 0;
    }
    const CellWindow window =
        revealed_cells(frame, navigable, {0, 0}, 0.0, {}, VlfmRules(rule));
    EXPECT_TRUE(revealed(window, frame, {1.5, 0.0}));
    EXPECT_FALSE(revealed(window, frame, {4.0, 0.0}));
    EXPECT_TRUE(revealed(window, frame, {3.5, 2.6}));  // Beside its shadow, at 36 degrees.
  }
}

TEST(FogOfWar, WhereTheRobotIsEnclosedNothingFarIsRevealed) {
  const GridFrame frame = square_frame();
  core::Image<std::uint8_t> navigable(400, 400, 1);
  for (int j = 190; j <= 210; ++j) {
    for (int i = 190; i <= 210; ++i) navigable(i, j) = 0;  // The robot stands inside of it.
  }
  const CellWindow window = revealed_cells(frame, navigable, {0, 0}, 0.0, {}, VlfmRules());
  EXPECT_EQ(count_of(window), 0);  // The nearest free piece is 10 cells away; 3 are allowed.
}

TEST(FogOfWar, OffTheMapNothingIsRevealed) {
  const GridFrame frame = square_frame();
  const core::Image<std::uint8_t> open(400, 400, 1);
  EXPECT_EQ(count_of(revealed_cells(frame, open, {30, 30}, 0.0, {}, VlfmRules())), 0);
  const CellWindow edge = revealed_cells(frame, open, {9.0, 0.0}, 0.0, {}, VlfmRules());
  for (int j = 0; j < edge.cells.height_px(); ++j) {
    for (int i = 0; i < edge.cells.width_px(); ++i) {
      if (edge.cells(i, j) != 0) {
        ASSERT_TRUE(frame.contains(edge.low + Cell(i, j)));
      }
    }
  }
}

}  // namespace
}  // namespace segsim::nav
