#include "nav/value/value_map.h"

#include <cmath>

#include <gtest/gtest.h>

#include "core/random.h"
#include "tests/nav/test_view.h"

namespace segsim::nav {
namespace {

using test::kNan;
using test::kPi;
using test::TestView;

double degrees(double angle_deg) { return angle_deg * kPi / 180.0; }

TEST(ValueMap, ConfidenceFallsOffTheAxis) {
  // Design notes A8, opening of 79 degrees.
  const double fov = degrees(79.0);
  EXPECT_NEAR(view_confidence(0.0, fov), 1.0, 1e-12);
  EXPECT_NEAR(view_confidence(degrees(10.0), fov), 0.887516, 1e-6);
  EXPECT_NEAR(view_confidence(degrees(-10.0), fov), 0.887516, 1e-6);
  EXPECT_NEAR(view_confidence(degrees(19.75), fov), 0.625, 1e-12);
  EXPECT_NEAR(view_confidence(degrees(30.0), fov), 0.352045, 1e-6);
  EXPECT_NEAR(view_confidence(degrees(39.5), fov), 0.25, 1e-12);
  // The threshold of 0.35 lies 30.10 degrees off.
  EXPECT_NEAR(view_confidence(degrees(30.10), fov), 0.35, 1e-4);
  // The paper's formula has no floor.
  EXPECT_NEAR(view_confidence(degrees(39.5), fov, 0.0), 0.0, 1e-12);
}

TEST(ValueMap, WeightedFusionReproducesTheWorkedValues) {
  const ValueMapOptions options;
  const auto expect = [&](ValueCell old, ValueCell seen, float c, float v) {
    const ValueCell now = fuse(old, seen, options);
    EXPECT_NEAR(now.confidence, c, 1e-6F);
    EXPECT_NEAR(now.value, v, 1e-6F);
  };
  expect({0.5F, 0.2F}, {1.0F, 0.4F}, 0.833333F, 0.333333F);
  expect({0.0F, 0.0F}, {0.3F, 0.3F}, 0.3F, 0.3F);
  expect({0.4F, 0.2F}, {0.3F, 0.9F}, 0.4F,
         0.2F);  // Below the threshold and below the old one.
  expect({0.3F, 0.2F}, {0.34F, 0.4F}, 0.32125F, 0.30625F);
  expect({0.0F, 0.0F}, {0.0F, 0.0F}, 0.0F, 0.0F);
}

TEST(ValueMap, OtherFusionRules) {
  ValueMapOptions options;
  options.fusion = FusionRule::kMaxConfidence;
  EXPECT_EQ(fuse({0.5F, 0.2F}, {0.6F, 0.9F}, options).value, 0.9F);
  EXPECT_EQ(fuse({0.7F, 0.2F}, {0.6F, 0.9F}, options).value, 0.2F);
  options.fusion = FusionRule::kReplace;
  EXPECT_EQ(fuse({0.7F, 0.2F}, {0.3F, 0.9F}, options).value, 0.9F);
  options.fusion = FusionRule::kEqualWeighting;
  ValueCell cell;
  for (const float value : {0.2F, 0.4F, 0.9F}) cell = fuse(cell, {0.5F, value}, options);
  EXPECT_NEAR(cell.value, 0.5F, 1e-6F);
}

/// What one view must leave in a cell, from the formulas alone.
ValueCell expected_after_first_view(const core::Observation& observation, double limit_m,
                                    const glm::dvec2& place_m, double value) {
  const glm::dvec2 eye(observation.T_odom_camera().translation_m());
  const double yaw = 2.0 * std::atan2(observation.T_odom_robot.rotation().z,
                                      observation.T_odom_robot.rotation().w);
  const glm::dvec2 offset = place_m - eye;
  const double forward = offset.x * std::cos(yaw) + offset.y * std::sin(yaw);
  const double left = -offset.x * std::sin(yaw) + offset.y * std::cos(yaw);
  const double fov = observation.intrinsics.horizontal_fov_rad();
  const double bearing = std::atan2(left, forward);
  if (std::abs(bearing) > 0.5 * fov || forward > limit_m || std::hypot(forward, left) > 5.0) {
    return {};
  }
  return {static_cast<float>(view_confidence(bearing, fov)), static_cast<float>(value)};
}

TEST(ValueMap, AViewFillsItsConeUpToItsDepth) {
  TestView view({1.0, -2.0, 0.7}, 3.0F);
  ValueMap map;
  map.update(view.observation, 0.6);
  int inside = 0, compared = 0;
  for (int j = 0; j < map.frame().height_cells; ++j) {
    for (int i = 0; i < map.frame().width_cells; ++i) {
      const glm::dvec2 place = map.frame().center_m({i, j});
      // Away from the borders, where rounding decides.
      const auto want = expected_after_first_view(view.observation, 3.0, place, 0.6);
      bool same = true;
      for (const glm::dvec2 push : {glm::dvec2(0.06, 0), {-0.06, 0}, {0, 0.06}, {0, -0.06}}) {
        const auto other = expected_after_first_view(view.observation, 3.0, place + push, 0.6);
        same &= (other.confidence > 0.0F) == (want.confidence > 0.0F);
      }
      if (!same) continue;
      ++compared;
      inside += want.confidence > 0.0F ? 1 : 0;
      const ValueCell got = map.cells()(i, j);
      ASSERT_NEAR(got.confidence, want.confidence, 1e-4F) << i << " " << j;
      ASSERT_NEAR(got.value, want.value, 1e-6F);
    }
  }
  EXPECT_GT(inside, 1500);  // Triangle of 3 m: 3 x 3 tan(39.5) = 7.4 m2, 2967 cells.
  EXPECT_GT(compared, 50000);
}

TEST(ValueMap, PublishedLooksAsFarAsTheFarthestPixelOfAColumn) {  // Q7
  TestView view({}, 1.0F);
  for (int x = 0; x < 64; ++x)
    view.depth(x, 0) = 4.0F;  // Over the near thing, at the ceiling.
  VlfmRules published;
  published.set(Quirk::kFarthestDepth, Rule::kVlfm);
  EXPECT_NEAR(column_limits_m(view.observation, {}, published)[32], 4.0F, 1e-6F);
  EXPECT_NEAR(column_limits_m(view.observation, {}, VlfmRules())[32], 1.0F, 1e-6F);
  ValueMap far({}, published), near;
  far.update(view.observation, 0.5);
  near.update(view.observation, 0.5);
  EXPECT_GT(far.at({2.0, 0.0}).confidence, 0.9F);
  EXPECT_EQ(near.at({2.0, 0.0}).confidence, 0.0F);
  EXPECT_GT(near.at({0.8, 0.0}).confidence, 0.9F);
}

TEST(ValueMap, PublishedSpreadsColumnsEvenlyInAngle) {  // Q7
  // Depth limits step at column 48 of 64: at tan = 16.5/64 * 2 tan(39.5) = 0.425 (23.0
  // degrees) truly, at 47.5/63 * 79 - 39.5 = 20.1 degrees as published.
  TestView view({}, 4.0F);
  for (int y = 0; y < 48; ++y) {
    for (int x = 48; x < 64; ++x) view.depth(x, y) = 1.0F;
  }
  VlfmRules published;
  published.set(Quirk::kFarthestDepth, Rule::kVlfm);
  ValueMap even({}, published), exact;
  even.update(view.observation, 0.5);
  exact.update(view.observation, 0.5);
  // 21.5 degrees to the right, 3 m forward.
  const glm::dvec2 between(3.0, -3.0 * std::tan(degrees(21.5)));
  EXPECT_EQ(even.at(between).confidence, 0.0F);
  EXPECT_GT(exact.at(between).confidence, 0.3F);
}

TEST(ValueMap, MedianOfTheValuesAround) {
  ValueMap map;
  EXPECT_FALSE(map.median_around({0.0, 0.0}));
  TestView view({}, 4.0F);
  map.update(view.observation, 0.25);
  EXPECT_NEAR(map.median_around({2.0, 0.0}).value(), 0.25, 1e-6);
  EXPECT_FALSE(map.median_around({-2.0, 0.0}));  // Behind the camera.
  EXPECT_FALSE(map.median_around({400.0, 0.0}));
}

TEST(ValueMap, DegenerateDepthAndOffMapAreHarmless) {
  for (const float depth : {kNan, std::numeric_limits<float>::infinity(), 0.0F, -1.0F}) {
    for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
      TestView view({}, depth);
      ValueMap map({}, VlfmRules(rule));
      map.update(view.observation, 0.5);
      for (int j = 0; j < map.frame().height_cells; ++j) {
        for (int i = 0; i < map.frame().width_cells; ++i) {
          const ValueCell& cell = map.cells()(i, j);
          ASSERT_TRUE(std::isfinite(cell.confidence) && std::isfinite(cell.value));
        }
      }
    }
  }
  ValueMapOptions small;
  small.growth.max_extent_m = 20.0;
  ValueMap map(small);
  TestView view({}, 3.0F);
  map.update(view.observation, 0.5);
  view.move_to({500.0, 0.0, 0.0});
  map.update(view.observation, 0.5);  // Does not fit: nothing is fused, nothing grows.
  EXPECT_LE(map.frame().width_cells, 400);
  EXPECT_GT(map.at({2.0, 0.0}).confidence, 0.9F);
}

TEST(ValueMap, PublishedIndicesWrap) {  // Q9
  VlfmRules published;
  published.set(Quirk::kMapEdge, Rule::kVlfm);
  ValueMap map({}, published);
  TestView view({}, 3.0F);
  map.update(view.observation, 0.5);
  EXPECT_EQ(map.frame().width_cells, 1000);
  view.move_to({-24.0, 0.0, kPi});  // Looks beyond the left edge, which lies at -25.025 m.
  map.update(view.observation, 0.9);
  EXPECT_NEAR(map.at({25.0 - 1.0, 0.0}).value, 0.9F, 1e-6F);  // At -26 m, seen from the end.
}

}  // namespace
}  // namespace segsim::nav
