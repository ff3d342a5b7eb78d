#include "nav/behaviours/spin.h"

#include <gmock/gmock.h>

namespace segsim::nav {
namespace {

TEST(Spin, EndsOnceAround) {
  Spin spin({.rate_radps = 1.0, .angle_rad = 2.0 * 3.14159265358979});
  spin.begin();
  double yaw_rad = 0.5, turned_rad = 0.0;
  while (const auto command = spin.command(yaw_rad)) {
    EXPECT_EQ(command->forward_mps, 0.0);
    EXPECT_EQ(command->turn_radps, 1.0);
    spin.end_decision(yaw_rad);
    yaw_rad = core::wrap_angle_rad(yaw_rad + 0.1);
    turned_rad += 0.1;
    ASSERT_LT(turned_rad, 10.0);
  }
  EXPECT_NEAR(turned_rad, 2.0 * 3.14159265358979, 0.1);
}

TEST(Spin, TurnsThatOthersCommandDoNotCount) {
  Spin spin({.rate_radps = 1.0, .angle_rad = 1.0});
  spin.begin();
  EXPECT_TRUE(spin.command(0.0));
  spin.end_decision(0.0);
  spin.end_decision(3.0);  // A recovery in between turned the robot.
  EXPECT_TRUE(spin.command(3.0));
  spin.end_decision(3.0);
  EXPECT_FALSE(spin.command(-2.2));  // By 1.08 rad, across the seam.
}

TEST(Spin, OfNoAngleIsSkipped) {
  Spin spin({.angle_rad = 0.0});
  EXPECT_FALSE(spin.command(0.0));
}

}  // namespace
}  // namespace segsim::nav
