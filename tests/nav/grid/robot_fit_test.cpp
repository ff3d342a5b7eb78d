#include "nav/grid/robot_fit.h"

#include <gtest/gtest.h>

#include "core/check.h"
#include "nav/frontier/frontier_policy.h"
#include "nav/vlfm/vlfm_policy.h"
#include "sim/ground/robot.h"
#include "tests/nav/robots.h"

namespace segsim::nav {
namespace {

TEST(RobotFit, TheTestsJackalIsTheSimulators) {
  const core::RobotBase ours = test::jackal(), its = sim::RobotModel::jackal_gentle();
  EXPECT_EQ(ours.length_m, its.length_m);
  EXPECT_EQ(ours.width_m, its.width_m);
  EXPECT_EQ(ours.body_top_m, its.body_top_m);
  EXPECT_EQ(ours.clearance_m, its.clearance_m);
  EXPECT_EQ(ours.mast_height_m, its.mast_height_m);
  EXPECT_EQ(ours.mast_radius_m, its.mast_radius_m);
  EXPECT_EQ(ours.max_forward_mps, its.max_forward_mps);
  EXPECT_EQ(ours.max_turn_radps, its.max_turn_radps);
  EXPECT_EQ(ours.max_acceleration_mps2, its.max_acceleration_mps2);
  EXPECT_EQ(ours.max_deceleration_mps2, its.max_deceleration_mps2);
  EXPECT_EQ(ours.max_turn_acceleration_radps2, its.max_turn_acceleration_radps2);
}

/// To the last bit: with these numbers the published figures were measured.
TEST(RobotFit, OfTheJackal) {
  const RobotFit fit = fit_of(test::jackal());
  EXPECT_EQ(fit.radius_m, 0.33);
  EXPECT_EQ(fit.tight_radius_m, 0.28);
  EXPECT_EQ(fit.narrow_radius_m, 0.235);
  EXPECT_EQ(fit.footprint_radius_m, 0.27);
  EXPECT_EQ(fit.inside_radius_m, 0.65 * 0.33);
  EXPECT_EQ(fit.mast_radius_m, 0.10);
  EXPECT_EQ(fit.obstacle_min_m, 0.10);
  EXPECT_EQ(fit.obstacle_max_m, 0.60);
}

void expect_equal(const FollowerOptions& a, const FollowerOptions& b) {
  EXPECT_EQ(a.footprint_radius_m, b.footprint_radius_m);
  EXPECT_EQ(a.slow_clearance_m, b.slow_clearance_m);
  EXPECT_EQ(a.max_forward_mps, b.max_forward_mps);
  EXPECT_EQ(a.max_turn_radps, b.max_turn_radps);
  EXPECT_EQ(a.max_accel_mps2, b.max_accel_mps2);
  EXPECT_EQ(a.window.half_length_m, b.window.half_length_m);
  EXPECT_EQ(a.window.half_width_m, b.window.half_width_m);
  EXPECT_EQ(a.window.max_accel_mps2, b.window.max_accel_mps2);
  EXPECT_EQ(a.window.max_turn_accel_radps2, b.window.max_turn_accel_radps2);
}

void expect_equal(const OccupancyOptions& a, const OccupancyOptions& b) {
  EXPECT_EQ(a.obstacle_min_m, b.obstacle_min_m);
  EXPECT_EQ(a.obstacle_max_m, b.obstacle_max_m);
  EXPECT_EQ(a.pass_height_m, b.pass_height_m);
  EXPECT_EQ(a.footprint_radius_m, b.footprint_radius_m);
  EXPECT_EQ(a.inside_radius_m, b.inside_radius_m);
  EXPECT_EQ(a.near_free_radius_m, b.near_free_radius_m);
}

TEST(RobotFit, TheDefaultsOfTheOptionsAreTheJackals) {
  const FrontierPolicyOptions fitted = frontier_for(test::jackal()), usual;
  expect_equal(fitted.occupancy, usual.occupancy);
  EXPECT_EQ(fitted.cost, usual.cost);
  expect_equal(fitted.follower, usual.follower);
  EXPECT_EQ(fitted.recovery.back_mps, usual.recovery.back_mps);
  EXPECT_EQ(fitted.distances.min_m, usual.distances.min_m);
  EXPECT_EQ(fitted.distances.max_m, usual.distances.max_m);
  EXPECT_EQ(fitted.tight_radius_m, usual.tight_radius_m);
  EXPECT_EQ(fitted.stop_distance_m, usual.stop_distance_m);

  const VlfmOptions vlfm = vlfm_for(test::jackal(), VlfmRules(), 1.2), plain;
  expect_equal(vlfm.follower, plain.follower);
  EXPECT_EQ(vlfm.cost, plain.cost);
  EXPECT_EQ(vlfm.tight_radii_m, plain.tight_radii_m);
  EXPECT_EQ(vlfm.distances.min_m, plain.distances.min_m);
  EXPECT_EQ(vlfm.stop_radius_m, plain.stop_radius_m);
  EXPECT_EQ(vlfm.obstacles.robot_radius_m, 0.33);
  EXPECT_EQ(vlfm.obstacles.band_min_m, 0.10);
  EXPECT_EQ(vlfm.obstacles.band_max_m, 0.60);
  EXPECT_EQ(vlfm.obstacles.mast_radius_m, 0.10);
}

/// Whoever adds a robot gets this test with it.
TEST(RobotFit, RadiiOfEveryRobotAreInOrder) {
  for (const std::string& name : sim::RobotModel::names()) {
    SCOPED_TRACE(name);
    const sim::RobotModel robot = sim::RobotModel::by_name(name);
    const RobotFit fit = fit_of(robot);
    EXPECT_NEAR(fit.radius_m, robot.circumscribed_radius_m(), 0.005);
    EXPECT_LT(fit.tight_radius_m, fit.radius_m);
    EXPECT_LE(fit.narrow_radius_m, fit.tight_radius_m);
    EXPECT_GT(fit.narrow_radius_m, robot.inscribed_radius_m());
    EXPECT_LT(fit.footprint_radius_m, fit.tight_radius_m);
    EXPECT_LE(fit.inside_radius_m, robot.inscribed_radius_m());
    EXPECT_LT(fit.obstacle_min_m, fit.obstacle_max_m);
    const FrontierPolicyOptions options = frontier_for(robot);
    EXPECT_LE(options.follower.max_forward_mps, robot.max_forward_mps);
    EXPECT_LE(options.follower.max_turn_radps, robot.max_turn_radps);
    EXPECT_LE(options.recovery.back_mps, robot.max_forward_mps);
  }
}

TEST(RobotFit, AShapeWithoutSizeIsABug) {
  EXPECT_THROW((void)fit_of({}), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::nav
