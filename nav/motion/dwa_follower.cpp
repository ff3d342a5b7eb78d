#include "nav/motion/dwa_follower.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "nav/motion/path_follower.h"

namespace segsim::nav {
namespace {

constexpr double kTurnGain_per_s = 2.5;

struct Range {
  double low, high;
  [[nodiscard]] double at(int k, int count) const {
    return count > 1 ? std::min(low + (high - low) * k / (count - 1), high) : low;
  }
};

double distance_to_path_m(const std::vector<glm::dvec2>& path_m, const glm::dvec2& place_m) {
  double best_m = glm::distance(path_m.front(), place_m);
  for (std::size_t k = 0; k + 1 < path_m.size(); ++k) {
    const glm::dvec2 along = path_m[k + 1] - path_m[k];
    const double length2 = glm::dot(along, along);
    const double t = length2 > 0.0
                         ? std::clamp(glm::dot(place_m - path_m[k], along) / length2, 0.0, 1.0)
                         : 0.0;
    best_m = std::min(best_m, glm::distance(path_m[k] + t * along, place_m));
  }
  return best_m;
}

/// Whether the arc is free; where the footprint touches already, whether it is at its end.
bool arc_free(const core::Pose2& pose, const core::VelocityCommand& command,
              const CostMap& map, const DwaOptions& options) {
  const bool touching = !footprint_free(pose, map, options);
  // The horizon and the way to a stop after it.
  const double stop_s = std::abs(command.forward_mps) / options.max_accel_mps2;
  const double whole_s = options.horizon_s + 0.5 * stop_s;
  for (double t = options.step_s; t <= whole_s + 1e-9; t += options.step_s) {
    if (touching && t + options.step_s <= whole_s) continue;
    if (!footprint_free(advance(pose, command, t), map, options)) return false;
  }
  return true;
}

double score_of(const core::Pose2& pose, const core::VelocityCommand& command,
                const glm::dvec2& towards_m, const std::vector<glm::dvec2>& path_m,
                const CostMap& map, const DwaOptions& options) {
  const glm::dvec2 from(pose.x_m, pose.y_m);
  // Beyond the point aimed at, coming nearer counts no more: stop the clock there.
  const double to_go_m = glm::distance(from, towards_m);
  const double duration_s = command.forward_mps > 1e-6
                                ? std::min(options.horizon_s, to_go_m / command.forward_mps)
                                : options.horizon_s;
  const core::Pose2 end = advance(pose, command, duration_s);
  const glm::dvec2 at(end.x_m, end.y_m);
  const double progress_m = to_go_m - glm::distance(at, towards_m);
  const glm::dvec2 ahead = towards_m - at;
  const double heading_rad =
      glm::length(ahead) > 0.05
          ? std::abs(core::wrap_angle_rad(std::atan2(ahead.y, ahead.x) - end.yaw_rad))
          : 0.0;
  const core::Pose2 middle = advance(pose, command, 0.5 * duration_s);
  const double off_m = 0.5 * (distance_to_path_m(path_m, at) +
                              distance_to_path_m(path_m, {middle.x_m, middle.y_m}));
  const double room_m =
      std::min(static_cast<double>(map.clearance_m(map.frame().cell_at(at))), 0.6);
  return options.progress_weight * progress_m - options.path_weight * off_m -
         options.heading_weight * heading_rad + options.clearance_weight * (room_m - 0.6);
}

}  // namespace

bool footprint_free(const core::Pose2& pose, const CostMap& map, const DwaOptions& options) {
  const GridFrame& frame = map.frame();
  const glm::dvec2 center(pose.x_m, pose.y_m);
  const double mast_m = static_cast<double>(map.mast_clearance_m(frame.cell_at(center)));
  if (mast_m < 0.7 * map.options().mast_radius_m) return false;
  const double half = 0.5 * frame.resolution_m;
  const double length_m = options.half_length_m + options.margin_m + half;
  const double width_m = options.half_width_m + options.margin_m + half;
  const double around_m = std::hypot(length_m, width_m);
  // Two circles spare most cells from being looked at one by one.
  const auto clearance_m = static_cast<double>(map.clearance_m(frame.cell_at(center)));
  if (clearance_m > around_m + 2.0 * half) return true;
  const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
  const CellBox box =
      CellBox{frame.cell_at(center - around_m), frame.cell_at(center + around_m)}.clipped_to(
          frame.box());
  for (int j = box.low.y; j <= box.high.y; ++j) {
    for (int i = box.low.x; i <= box.high.x; ++i) {
      if (map.state({i, j}) != CellState::kOccupied) continue;
      const glm::dvec2 d = frame.center_m({i, j}) - center;
      if (std::abs(c * d.x + s * d.y) <= length_m && std::abs(c * d.y - s * d.x) <= width_m) {
        return false;
      }
    }
  }
  return true;
}

std::vector<DwaCandidate> dwa_candidates(const core::Pose2& pose,
                                         const core::VelocityCommand& now,
                                         const glm::dvec2& towards_m,
                                         const std::vector<glm::dvec2>& path_m,
                                         const CostMap& map, const DwaOptions& options) {
  const double dv = options.max_accel_mps2 * options.period_s;
  const double dw = options.max_turn_accel_radps2 * options.period_s;
  const Range forward{std::max(-options.max_backward_mps, now.forward_mps - dv),
                      std::min(options.max_forward_mps, now.forward_mps + dv)};
  const Range turn{std::max(-options.max_turn_radps, now.turn_radps - dw),
                   std::min(options.max_turn_radps, now.turn_radps + dw)};
  std::vector<DwaCandidate> candidates{{}};
  for (int a = 0; a < options.forward_samples; ++a) {
    for (int b = 0; b < options.turn_samples; ++b) {
      candidates.push_back(
          {{forward.at(a, options.forward_samples), turn.at(b, options.turn_samples)}});
    }
  }
  for (DwaCandidate& candidate : candidates) {
    candidate.admissible = arc_free(pose, candidate.command, map, options);
    if (!candidate.admissible) continue;
    candidate.score = score_of(pose, candidate.command, towards_m, path_m, map, options);
  }
  return candidates;
}

DwaFollower::DwaFollower(const DwaOptions& options) : options_(options) {
  SEGSIM_CHECK(options.max_forward_mps > 0.0 && options.max_turn_radps > 0.0, "speed limits");
  SEGSIM_CHECK(options.max_accel_mps2 > 0.0 && options.max_turn_accel_radps2 > 0.0,
               "acceleration limits");
  SEGSIM_CHECK(options.forward_samples >= 1 && options.turn_samples >= 1, "samples");
  SEGSIM_CHECK(options.step_s > 0.0 && options.horizon_s >= options.step_s, "horizon_s");
}

void DwaFollower::clear() {
  set_path({});
  last_ = {};
  blocked_ = false;
}

core::VelocityCommand DwaFollower::follow(const core::Pose2& pose, const CostMap& map) {
  blocked_ = false;
  const glm::dvec2 position(pose.x_m, pose.y_m);
  if (path_.points_m.empty() ||
      glm::distance(path_.points_m.back(), position) <= options_.goal_tolerance_m) {
    return last_ = {};
  }
  const glm::dvec2 towards_m =
      progress_.point_ahead(path_.points_m, position, options_.lookahead_m);
  const DwaCandidate* best = nullptr;
  const std::vector<DwaCandidate> candidates =
      dwa_candidates(pose, last_, towards_m, path_.points_m, map, options_);
  for (const DwaCandidate& candidate : candidates) {
    if (!candidate.admissible || std::abs(candidate.command.forward_mps) < 0.02) continue;
    if (best == nullptr || candidate.score > best->score) best = &candidate;
  }
  // Standing still scores what the place is worth; only an arc that leads on is better.
  if (best != nullptr &&
      (!candidates.front().admissible || best->score > candidates.front().score)) {
    return last_ = best->command;
  }
  const double error = core::wrap_angle_rad(
      std::atan2(towards_m.y - position.y, towards_m.x - position.x) - pose.yaw_rad);
  blocked_ = std::abs(error) < 0.3;  // Nothing is left to turn to.
  const double rate =
      std::clamp(kTurnGain_per_s * std::abs(error), kMinTurn_radps, options_.max_turn_radps);
  return last_ = {0.0, std::copysign(rate, error)};
}

}  // namespace segsim::nav
