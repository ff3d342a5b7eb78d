#include "sim/sensors/pose_history.h"

#include <cmath>

#include <gtest/gtest.h>

#include "core/check.h"
#include "core/random.h"
#include "sim/ground/robot.h"

namespace segsim::sim {
namespace {

void expect_near(const core::Pose2& found, const core::Pose2& expected, double tolerance) {
  EXPECT_NEAR(found.x_m, expected.x_m, tolerance);
  EXPECT_NEAR(found.y_m, expected.y_m, tolerance);
  EXPECT_NEAR(core::wrap_angle_rad(found.yaw_rad - expected.yaw_rad), 0.0, tolerance);
}

TEST(PoseBetween, LiesOnTheArcThatIsDriven) {
  core::RandomStream random(1, "arcs");
  for (int k = 0; k < 200; ++k) {
    const core::Pose2 start{random.uniform(-5, 5), random.uniform(-5, 5),
                            random.uniform(-3, 3)};
    // Straight ones, turns on the spot and arcs of up to half a circle.
    const core::VelocityCommand velocity{k % 3 == 0 ? 0.0 : random.uniform(-2, 2),
                                         k % 3 == 1 ? 0.0 : random.uniform(-3, 3)};
    const core::Pose2 end = drive_arc(start, velocity, 1.0);
    const double share = random.uniform();
    expect_near(pose_between(start, end, share), drive_arc(start, velocity, share), 1e-9);
  }
}

TEST(PoseBetween, EndsAreTheTwoPoses) {
  const core::Pose2 a{1.0, 2.0, 3.0}, b{1.5, 2.2, -3.0};
  expect_near(pose_between(a, b, 0.0), a, 1e-12);
  expect_near(pose_between(a, b, 1.0), b, 1e-12);
}

TEST(PoseHistory, FindsTheStepAndForgets) {
  PoseHistory history(0, {0.0, 0.0, 0.0});
  for (int k = 1; k <= 10; ++k) history.add(k * 100, {0.1 * k, 0.0, 0.0});
  EXPECT_NEAR(history.at(0).x_m, 0.0, 1e-15);
  EXPECT_NEAR(history.at(350).x_m, 0.35, 1e-12);
  EXPECT_EQ(history.at(400).x_m, 0.4) << "a step itself, bit for bit";
  EXPECT_EQ(history.at(1000).x_m, 1.0);
  history.forget_before(450);
  EXPECT_EQ(history.first_ns(), 400);
  EXPECT_NEAR(history.at(450).x_m, 0.45, 1e-12);
  EXPECT_THROW((void)history.at(399), core::ContractViolation);
  EXPECT_THROW((void)history.at(1001), core::ContractViolation);
  EXPECT_THROW(history.add(999, {}), core::ContractViolation);
  history.add(1000, {7.0, 0.0, 0.0});
  EXPECT_EQ(history.at(1000).x_m, 7.0) << "the same time again replaces it";
}

}  // namespace
}  // namespace segsim::sim
