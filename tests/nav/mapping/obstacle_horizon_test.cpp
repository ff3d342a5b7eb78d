#include "nav/mapping/obstacle_horizon.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <gtest/gtest.h>

#include "core/random.h"

namespace segsim::nav {
namespace {

constexpr int kReach = 40, kSide = 2 * kReach + 1;

/// Steps of one cell that a ray makes before it stands in an obstacle.
int steps_before_obstacle(const core::Image<std::uint8_t>& obstacles, double x, double y,
                          double angle_rad) {
  for (int k = 0; k < kReach; ++k) {
    const auto i = static_cast<int>(x + k * std::cos(angle_rad));
    const auto j = static_cast<int>(y + k * std::sin(angle_rad));
    if (obstacles(i, j) != 0) return k;
  }
  return kReach;
}

TEST(ObstacleHorizon, NoRayMeetsAnObstacleBeforeIt) {
  core::RandomStream random(4, "horizon");
  ObstacleHorizon horizon;
  for (int round = 0; round < 60; ++round) {
    core::Image<std::uint8_t> obstacles(kSide, kSide);
    const auto count = random.index(round < 20 ? 6 : 200);
    for (std::uint32_t k = 0; k < count; ++k) {
      obstacles(static_cast<int>(random.index(kSide)), static_cast<int>(random.index(kSide))) =
          1;
    }
    horizon.find(obstacles);
    for (int ray = 0; ray < 2000; ++ray) {
      const double x = kReach + random.uniform(), y = kReach + random.uniform();
      const double angle_rad = random.uniform(-std::numbers::pi, std::numbers::pi);
      const int free_cells = horizon.free_cells(static_cast<float>(std::cos(angle_rad)),
                                                static_cast<float>(std::sin(angle_rad)));
      ASSERT_LE(std::min(free_cells, kReach),
                steps_before_obstacle(obstacles, x, y, angle_rad))
          << x << " " << y << " " << angle_rad;
    }
  }
}

TEST(ObstacleHorizon, EndsShortOfTheObstacleAndOnlyInItsDirection) {
  core::Image<std::uint8_t> obstacles(kSide, kSide);
  for (const auto& [dx, dy] : {std::pair{30, 0}, {0, 30}, {-30, 0}, {0, -30}, {-21, 21}}) {
    std::fill(obstacles.pixels().begin(), obstacles.pixels().end(), std::uint8_t{0});
    obstacles(kReach + dx, kReach + dy) = 1;
    ObstacleHorizon horizon;
    horizon.find(obstacles);
    const double angle_rad = std::atan2(dy, dx);
    const auto free_cells = [&](double off_rad) {
      return horizon.free_cells(static_cast<float>(std::cos(angle_rad + off_rad)),
                                static_cast<float>(std::sin(angle_rad + off_rad)));
    };
    EXPECT_GE(free_cells(0.0), 26);
    EXPECT_LE(free_cells(0.0), 30);
    EXPECT_GE(free_cells(0.2), kReach);
    EXPECT_GE(free_cells(-0.2), kReach);
    EXPECT_GE(free_cells(std::numbers::pi), kReach);
  }
}

}  // namespace
}  // namespace segsim::nav
