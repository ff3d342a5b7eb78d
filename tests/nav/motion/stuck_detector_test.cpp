#include "nav/motion/stuck_detector.h"

#include <gmock/gmock.h>

namespace segsim::nav {
namespace {

TEST(StuckDetector, NoticesStandingWhileDriving) {
  StuckDetector detector;
  for (int k = 0; k < 19; ++k) detector.add({1.0 + 0.001 * k, 0.0, 0.0}, {0.3, 0.0});
  EXPECT_FALSE(detector.stuck());
  detector.add({1.02, 0.0, 0.0}, {0.3, 0.0});
  EXPECT_TRUE(detector.stuck());
}

TEST(StuckDetector, StandingOnPurposeIsFine) {
  StuckDetector detector;
  for (int k = 0; k < 60; ++k)
    detector.add({}, k % 10 == 0 ? core::VelocityCommand{} : core::VelocityCommand{0.3, 0.0});
  EXPECT_FALSE(detector.stuck());
}

TEST(StuckDetector, AWholeTurnIsMotionAlthoughItEndsWhereItBegan) {
  StuckDetector detector;
  for (int k = 0; k < 20; ++k) {
    detector.add({0.0, 0.0, core::wrap_angle_rad(2.0 * 3.14159265 * k / 19.0)}, {0.0, 1.0});
  }
  EXPECT_FALSE(detector.stuck());
}

}  // namespace
}  // namespace segsim::nav
