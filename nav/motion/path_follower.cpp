#include "nav/motion/path_follower.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::nav {
namespace {

constexpr double kSimulationStep_s = 0.1;

}  // namespace

core::Pose2 advance(const core::Pose2& pose, const core::VelocityCommand& command,
                    double dt_s) {
  const double turn = command.turn_radps * dt_s;
  const double distance = command.forward_mps * dt_s;
  // Chord of the arc: sin(turn/2)/(turn/2) long, in the direction of half the turn.
  const double half = 0.5 * turn;
  const double chord = std::abs(half) < 1e-6 ? distance : distance * std::sin(half) / half;
  return {pose.x_m + chord * std::cos(pose.yaw_rad + half),
          pose.y_m + chord * std::sin(pose.yaw_rad + half),
          core::wrap_angle_rad(pose.yaw_rad + turn)};
}

namespace {

DwaOptions with_limits_of(const FollowerOptions& options) {
  DwaOptions window = options.window;
  window.max_forward_mps = options.max_forward_mps;
  window.max_turn_radps = options.max_turn_radps;
  window.goal_tolerance_m = options.goal_tolerance_m;
  return window;
}

}  // namespace

PathFollower::PathFollower(const FollowerOptions& options)
    : options_(options), window_(with_limits_of(options)) {
  SEGSIM_CHECK(options.max_forward_mps > 0.0 && options.max_turn_radps > 0.0, "speed limits");
  SEGSIM_CHECK(options.lookahead_m > 0.0, "lookahead_m");
}

void PathFollower::set_path(const Path& path) {
  path_ = path;
  progress_.reset();
  blocked_ = false;
  window_.set_path(path);
}

void PathFollower::clear() {
  set_path({});
  window_.clear();
}

bool PathFollower::arrived(const core::Pose2& pose) const {
  return has_path() && glm::distance(path_.points_m.back(), glm::dvec2(pose.x_m, pose.y_m)) <=
                           options_.goal_tolerance_m;
}

bool PathFollower::safe(const core::Pose2& pose, const core::VelocityCommand& command,
                        const CostMap& map) const {
  const auto clearance = [&](const core::Pose2& at) {
    const Cell cell = map.frame().cell_at({at.x_m, at.y_m});
    // Both layers on one scale: metres by which the footprint is kept.
    return std::min(
        static_cast<double>(map.clearance_m(cell)) - options_.footprint_radius_m,
        static_cast<double>(map.mast_clearance_m(cell)) - 0.7 * map.options().mast_radius_m);
  };
  // Inside a violated footprint only motion that does not go deeper is allowed, up to the
  // jitter of distances between cell centres.
  const double allowed = std::min(0.0, clearance(pose) - 0.6 * map.frame().resolution_m);
  double deepest = 0.0;
  for (double t = kSimulationStep_s; t <= options_.horizon_s + 1e-9; t += kSimulationStep_s) {
    deepest = std::min(deepest, clearance(advance(pose, command, t)));
  }
  const bool violated = clearance(pose) < 0.0;
  return deepest >= (violated ? allowed : 0.0);
}

core::VelocityCommand PathFollower::turn_to(const core::Pose2& pose, double yaw_rad,
                                            double tolerance_rad) const {
  const double error = core::wrap_angle_rad(yaw_rad - pose.yaw_rad);
  if (std::abs(error) <= tolerance_rad) return {};
  const double rate = std::clamp(options_.turn_gain_per_s * std::abs(error), kMinTurn_radps,
                                 options_.max_turn_radps);
  return {0.0, std::copysign(rate, error)};
}

core::VelocityCommand PathFollower::follow(const core::Pose2& pose, const CostMap& map) {
  blocked_ = false;
  if (!has_path() || arrived(pose)) return {};
  if (options_.motion == LocalMotion::kDynamicWindow) {
    const core::VelocityCommand command = window_.follow(pose, map);
    blocked_ = window_.blocked();
    return command;
  }
  const glm::dvec2 position(pose.x_m, pose.y_m);
  const glm::dvec2 offset =
      progress_.point_ahead(path_.points_m, position, options_.lookahead_m) - position;
  const double distance_m = std::max(glm::length(offset), 1e-3);
  const double heading = std::atan2(offset.y, offset.x);
  const double error = core::wrap_angle_rad(heading - pose.yaw_rad);
  if (std::abs(error) > options_.turn_in_place_above_rad) return turn_to(pose, heading);

  // Speed: slower near obstacles, at the end and while the heading is off.
  const double clearance_m =
      static_cast<double>(map.clearance_m(map.frame().cell_at(position)));
  const double room = std::clamp((clearance_m - options_.footprint_radius_m) /
                                     (options_.slow_clearance_m - options_.footprint_radius_m),
                                 0.0, 1.0);
  const double near_obstacles =
      options_.min_clearance_factor + (1.0 - options_.min_clearance_factor) * room;
  const double to_goal_m = glm::distance(position, path_.points_m.back());
  double speed = options_.max_forward_mps * near_obstacles * std::cos(error) * std::cos(error);
  speed = std::min(speed, std::sqrt(2.0 * options_.max_accel_mps2 * 0.5 * to_goal_m));
  speed = std::max(speed, options_.min_forward_mps);

  // Pure pursuit: the arc through the lookahead point. The turn limit also limits the speed.
  const double curvature = 2.0 * std::sin(error) / distance_m;
  if (std::abs(curvature) * speed > options_.max_turn_radps) {
    speed = options_.max_turn_radps / std::abs(curvature);
  }
  for (const double share : {1.0, 0.6, 0.3}) {
    const core::VelocityCommand command{share * speed, share * speed * curvature};
    if (safe(pose, command, map)) return command;
  }
  blocked_ = true;
  return turn_to(pose, heading);
}

}  // namespace segsim::nav
