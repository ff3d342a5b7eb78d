#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "core/random.h"
#include "nav/vlfm/internal/vlfm_search.h"

namespace segsim::nav::internal {
namespace {

constexpr double kSamePlace_m = 0.05;
constexpr double kBackSpeed_mps = 0.2;
constexpr double kRecoverPhase_s = 3.0;
// Radius of what was felt, not seen; more each time around the same place.
constexpr double kFelt_m = 0.10, kFeltMore_m = 0.05, kFeltMost_m = 0.25;
constexpr double kFeltNear_m = 0.5;

}  // namespace

core::VelocityCommand VlfmSearch::start(DiscreteAction action, const Now& now) {
  executor_.start(action, now.pose, now.time_ns);
  return executor_.command(now.pose, now.time_ns, now.period_s);
}

core::VelocityCommand VlfmSearch::spin(const Now& now) {
  const auto done = [&] {
    mode_ = core::PolicyMode::kExplore;
    stuck_.reset();
    return core::VelocityCommand{};
  };
  if (options_.motion == Motion::kDiscrete) {
    if (turns_ >= options_.spin_turns) return done();
    ++turns_;
    return start(DiscreteAction::kTurnLeft, now);
  }
  spun_rad_ += core::wrap_angle_rad(now.pose.yaw_rad - last_yaw_rad_);
  if (spun_rad_ >= options_.spin_turns * options_.actions.turn_rad - 0.05) return done();
  return {0.0, options_.follower.max_turn_radps};
}

bool VlfmSearch::replan_due(const Now& now) const {
  return planned_ns_ < 0 || !follower_.has_path() ||
         core::seconds(now.time_ns - planned_ns_) >= options_.replan_period_s - 1e-6;
}

/// Occupied, explored or unknown; the unknown may be crossed at a price, as VLFM's network
/// would.
void VlfmSearch::refresh_cost_map() {
  CostMapOptions cost = options_.cost;
  cost.cross_unknown = true;
  if (squeezes_ > 0) {
    cost.robot_radius_m = std::min(cost.robot_radius_m, options_.tight_radii_m[squeezes_ - 1]);
    cost.margin_m = 0.0;
  }
  const GridFrame& frame = obstacles_.frame();
  CellBox active = obstacles_.observed();
  if (active.empty()) {  // Nothing yet.
    active.add(Cell(frame.width_cells / 2, frame.height_cells / 2));
  }
  cost_.update(frame, obstacles_.occupied(), obstacles_.explored(), obstacles_.mast(), active,
               obstacles_.take_changed(), cost);
}

core::VelocityCommand VlfmSearch::drive(const Now& now, const glm::dvec2& place_m,
                                        bool exploring) {
  if (options_.motion == Motion::kDiscrete) {
    const DiscreteAction action =
        options_.local->act(*now.observation, now.pose, place_m, cost_);
    if (action != DiscreteAction::kStop) return start(action, now);
    if (options_.rules.published(Quirk::kLocalStop)) {
      // STOP of the local policy ends the episode, wherever that is.
      if (exploring) stop(core::StopReason::kPointnavStop);
    } else if (exploring) {
      vetoed_m_.push_back(place_m);
    }
    return {};
  }
  if (planned_ns_ < 0 || glm::distance(planned_for_m_, place_m) > kSamePlace_m) {
    const auto path = plan_path(cost_, now.position_m, place_m, &planner_);
    planned_ns_ = now.time_ns;
    planned_for_m_ = place_m;
    if (!path) {
      follower_.clear();
      if (exploring) vetoed_m_.push_back(place_m);
      return {};
    }
    follower_.set_path(*path);
  }
  if (exploring && follower_.arrived(now.pose)) vetoed_m_.push_back(place_m);
  return follower_.follow(now.pose, cost_);
}

core::VelocityCommand VlfmSearch::face(const Now& now, double bearing_rad) {
  if (options_.motion == Motion::kPursuit) {
    return follower_.turn_to(now.pose, bearing_rad, 0.05);
  }
  const double error = core::wrap_angle_rad(bearing_rad - now.pose.yaw_rad);
  if (std::abs(error) <= options_.actions.turn_above_rad) return {};
  return start(error > 0.0 ? DiscreteAction::kTurnLeft : DiscreteAction::kTurnRight, now);
}

void VlfmSearch::begin_recovery(const Now& now) {
  if (recoveries_ >= options_.max_recoveries) {
    stop(core::StopReason::kStuck);
    return;
  }
  core::RandomStream random(seed_, "vlfm_recovery", static_cast<std::uint64_t>(recoveries_));
  const double turn =
      random.uniform(options_.recover_turn_min_rad, options_.recover_turn_max_rad);
  recovery_yaw_rad_ = now.pose.yaw_rad + (random.chance(0.5) ? turn : -turn);
  const glm::dvec2 ahead(std::cos(now.pose.yaw_rad), std::sin(now.pose.yaw_rad));
  const auto before = std::count_if(
      stuck_places_m_.begin(), stuck_places_m_.end(), [&](const glm::dvec2& place_m) {
        return glm::distance(place_m, now.position_m) < kFeltNear_m;
      });
  const double felt_m =
      std::min(kFelt_m + kFeltMore_m * static_cast<double>(before), kFeltMost_m);
  obstacles_.mark_blocked_disc(
      now.position_m + (options_.obstacles.robot_radius_m + 0.05) * ahead, felt_m);
  stuck_places_m_.push_back(now.position_m);
  ++recoveries_;
  recovering_ = true;
  recovery_turning_ = false;
  recovery_start_ = now.pose;
  recovery_since_ns_ = now.time_ns;
  mode_ = core::PolicyMode::kRecover;
  executor_.reset();
  follower_.clear();
  target_m_.reset();
  stuck_.reset();
}

core::VelocityCommand VlfmSearch::recover(const Now& now) {
  const double elapsed_s = core::seconds(now.time_ns - recovery_since_ns_);
  if (!recovery_turning_) {
    const double backed_m =
        std::hypot(now.pose.x_m - recovery_start_.x_m, now.pose.y_m - recovery_start_.y_m);
    if (backed_m < options_.recover_back_m && elapsed_s < kRecoverPhase_s) {
      return {-kBackSpeed_mps, 0.0};
    }
    recovery_turning_ = true;
    recovery_since_ns_ = now.time_ns;
    return follower_.turn_to(now.pose, recovery_yaw_rad_, 0.15);
  }
  const core::VelocityCommand turn = follower_.turn_to(now.pose, recovery_yaw_rad_, 0.15);
  if (turn.turn_radps != 0.0 && elapsed_s < kRecoverPhase_s) return turn;
  recovering_ = false;
  mode_ = core::PolicyMode::kExplore;
  planned_ns_ = -1;
  return {};
}

}  // namespace segsim::nav::internal
