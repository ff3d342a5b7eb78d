#include "nav/behaviours/fitted_options.h"

#include <algorithm>

namespace segsim::nav {
namespace {

// Beyond the planner's or the follower's circle.
constexpr double kNearFree_m = 0.22;  // What the camera cannot see around the robot.
constexpr double kSoft_m = 0.32;      // Obstacles nearer than this cost extra.
constexpr double kSlow_m = 0.28;      // Nearer to obstacles it drives slowly.
constexpr double kBesideObject_m = 0.10;

}  // namespace

OccupancyOptions fitted(OccupancyOptions options, const core::RobotBase& robot) {
  const RobotFit fit = fit_of(robot);
  options.obstacle_min_m = fit.obstacle_min_m;
  options.obstacle_max_m = fit.obstacle_max_m;
  options.pass_height_m = std::min(options.pass_height_m, fit.obstacle_max_m);
  options.footprint_radius_m = fit.radius_m;
  options.inside_radius_m = fit.inside_radius_m;
  options.near_free_radius_m = fit.radius_m + kNearFree_m;
  return options;
}

CostMapOptions fitted(CostMapOptions options, const core::RobotBase& robot) {
  const RobotFit fit = fit_of(robot);
  options.robot_radius_m = fit.radius_m;
  options.mast_radius_m = fit.mast_radius_m;
  options.soft_distance_m = fit.radius_m + kSoft_m;
  return options;
}

FollowerOptions fitted(FollowerOptions options, const core::RobotBase& robot) {
  const RobotFit fit = fit_of(robot);
  options.footprint_radius_m = fit.footprint_radius_m;
  options.slow_clearance_m = fit.footprint_radius_m + kSlow_m;
  options.max_forward_mps = std::min(options.max_forward_mps, robot.max_forward_mps);
  options.max_turn_radps = std::min(options.max_turn_radps, robot.max_turn_radps);
  options.max_accel_mps2 = std::min(options.max_accel_mps2, robot.max_deceleration_mps2);
  DwaOptions& window = options.window;
  window.half_length_m = 0.5 * robot.length_m;
  window.half_width_m = 0.5 * robot.width_m;
  window.max_accel_mps2 =
      std::min({window.max_accel_mps2, robot.max_acceleration_mps2, options.max_accel_mps2});
  window.max_turn_accel_radps2 =
      std::min(window.max_turn_accel_radps2, robot.max_turn_acceleration_radps2);
  return options;
}

DiscreteMotionOptions fitted(DiscreteMotionOptions options, const core::RobotBase& robot) {
  options.max_forward_mps = std::min(options.max_forward_mps, robot.max_forward_mps);
  options.max_turn_radps = std::min(options.max_turn_radps, robot.max_turn_radps);
  return options;
}

RecoveryOptions fitted(RecoveryOptions options, const core::RobotBase& robot) {
  options.back_mps = std::min(options.back_mps, robot.max_forward_mps);
  return options;
}

ApproachDistances fitted(ApproachDistances distances, const core::RobotBase& robot) {
  distances.min_m = std::max(distances.min_m, fit_of(robot).radius_m + kBesideObject_m);
  distances.max_m = std::max(distances.max_m, distances.min_m);
  return distances;
}

}  // namespace segsim::nav
