#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "nav/vlfm/internal/vlfm_search.h"

namespace segsim::nav::internal {
namespace {

constexpr double kSamePlace_m = 0.05;

}  // namespace

core::VelocityCommand VlfmSearch::start(DiscreteAction action, const Now& now) {
  executor_.start(action, now.pose, now.time_ns);
  return executor_.command(now.pose, now.time_ns, now.period_s);
}

void VlfmSearch::begin_spin() {
  turns_ = 0;
  spin_.begin();
}

std::optional<core::VelocityCommand> VlfmSearch::turn_around(const Now& now) {
  const bool discrete = options_.motion == Motion::kDiscrete;
  if (discrete && turns_ < options_.spin_turns) {
    ++turns_;
    return start(DiscreteAction::kTurnLeft, now);
  }
  const auto command = discrete ? std::nullopt : spin_.command(now.pose.yaw_rad);
  if (!command) recovery_.forget_motion();
  return command;
}

bool VlfmSearch::replan_due(const Now& now) const {
  return !follower_.has_path() || replan_.due(now.time_ns);
}

/// Occupied, explored or unknown; the unknown may be crossed at a price, as VLFM's network
/// would.
void VlfmSearch::refresh_cost_map() {
  CostMapOptions cost = options_.cost;
  cost.cross_unknown = true;
  if (squeezes_ > 0) cost = tightened(cost, options_.tight_radii_m[squeezes_ - 1]);
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
  if (replan_.demanded() || glm::distance(planned_for_m_, place_m) > kSamePlace_m) {
    const auto path = plan_path(cost_, now.position_m, place_m, &planner_);
    replan_.planned(now.time_ns);
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
  if (recovery_.exhausted()) {
    stop(core::StopReason::kStuck);
    return;
  }
  if (const std::optional<FeltDisc> felt = recovery_.begin(now)) {
    obstacles_.mark_blocked_disc(felt->center_m, felt->radius_m);
  }
  mode_ = core::PolicyMode::kRecover;
  executor_.reset();
  follower_.clear();
  target_m_.reset();
}

core::VelocityCommand VlfmSearch::recover(const Now& now) {
  if (const auto command = recovery_.command(now, follower_, cost_)) return *command;
  mode_ = core::PolicyMode::kExplore;
  replan_.demand();
  return {};
}

}  // namespace segsim::nav::internal
