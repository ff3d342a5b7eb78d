/// Looking around, driving to frontiers, and what is tried when none is left.

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "nav/frontier/internal/search_policy.h"

namespace segsim::nav::internal {
namespace {

constexpr double kAtFrontier_m = 0.35;  // A frontier this near to a looked-at one is the same.

}  // namespace

void SearchPolicy::begin_spin() {
  state_ = State::kSpin;
  spin_.begin();
  follower_.clear();
  recovery_.forget_motion();
}

core::VelocityCommand SearchPolicy::spin(const Now& now) {
  if (const auto command = spin_.command(now.pose.yaw_rad)) return *command;
  resume_search();
  return {};
}

void SearchPolicy::resume_search() {
  target_.reset();
  follower_.clear();
  state_ = sweep_.place_m() ? State::kSweep : State::kExplore;
  replan_.demand();
}

core::VelocityCommand SearchPolicy::look(const Now& now) {
  const bool all_around = target_->outward == glm::dvec2(0.0);
  const double yaw_rad =
      all_around ? now.pose.yaw_rad : std::atan2(target_->outward.y, target_->outward.x);
  const core::VelocityCommand command = follower_.turn_to(now.pose, yaw_rad, 0.15);
  const bool late = core::seconds(now.time_ns - target_->since_ns) > options_.target_timeout_s;
  if (command.turn_radps != 0.0 && !late) return command;
  if (target_->bold) {
    selector_.blacklist(target_->position_m);
  } else {
    looked_at_m_ = target_->position_m;
  }
  target_.reset();
  state_ = State::kExplore;
  replan_.demand();
  return {};
}

core::VelocityCommand SearchPolicy::sweep(const Now& now) {
  if (replan_due(now)) {
    replan_.planned(now.time_ns);
    while (sweep_.place_m() && !drive_to(now, *sweep_.place_m())) sweep_.leave(now.time_ns);
    if (!sweep_.place_m()) {
      state_ = State::kExplore;
      replan_.demand();
      return {};
    }
    track_target(now, *sweep_.place_m(), glm::dvec2(0.0));
  }
  const bool arrived = follower_.arrived(now.pose);
  if (arrived || hopeless(now)) {
    sweep_.leave(now.time_ns);
    target_.reset();
    replan_.demand();
    if (arrived) {
      begin_spin();
    } else if (!sweep_.place_m()) {
      state_ = State::kExplore;
    }
    return {};
  }
  return follower_.follow(now.pose, cost_);
}

bool SearchPolicy::replan_explore(const Now& now) {
  replan_.planned(now.time_ns);
  const bool known = field_.begin(cost_, cost_.frame().cell_at(now.position_m));
  const bool bold = effort_ == Effort::kBold || effort_ == Effort::kBoldAgain;
  FrontierOptions options = options_.frontiers;
  if (effort_ != Effort::kNormal) options.min_length_m = 0.0;
  frontiers_ =
      known ? find_reachable_frontiers(cost_, field_, options) : std::vector<Frontier>{};
  while (true) {
    const std::optional<Frontier> frontier = selector_.select(frontiers_, field_);
    if (!frontier) return bold && replan_bold(now);
    const bool seen_it_all =
        looked_at_m_ && glm::distance(*looked_at_m_, frontier->waypoint_m) <= kAtFrontier_m;
    if (!seen_it_all && drive_to(now, frontier->waypoint_m)) {
      track_target(now, frontier->waypoint_m, frontier->outward);
      return true;
    }
    // Looked at from its very edge, or no way there: not worth another try.
    selector_.blacklist(frontier->waypoint_m);
  }
}

bool SearchPolicy::replan_bold(const Now& now) {
  build_bold_map();
  const GridFrame& frame = bold_.frame();
  if (!field_.begin(bold_, frame.cell_at(now.position_m))) return false;
  const CellBox part = bold_.active();
  core::Image<std::uint8_t> known(part.width(), part.height());
  for (int j = 0; j < part.height(); ++j) {
    const CellState* states = bold_.states().row(j + part.low.y) + part.low.x;
    for (int i = 0; i < part.width(); ++i) {
      known(i, j) = states[i] != CellState::kUnknown ? 1 : 0;
    }
  }
  const core::Image<float> depth_m = distance_to_cells_m(known, frame.resolution_m);
  if (target_ && target_->bold) {  // Stay with it while it is worth it.
    const Cell cell = frame.cell_at(target_->position_m);
    if (bold_.state(cell) == CellState::kUnknown && field_.reachable(cell) &&
        drive_to(now, target_->position_m, bold_)) {
      track_target(now, target_->position_m, glm::dvec2(0.0));
      return true;
    }
  }
  // The nearest of many places: the field is searched until it comes to one.
  const auto wanted = [&](const Cell& cell) {
    const Cell at = cell - part.low;
    return known.contains(at.x, at.y) &&
           static_cast<double>(depth_m(at.x, at.y)) >= options_.bold_depth_m &&
           !selector_.blacklisted(frame.center_m(cell));
  };
  const std::optional<Cell> best = field_.nearest_of(wanted);
  if (!best || !drive_to(now, frame.center_m(*best), bold_)) return false;
  track_target(now, frame.center_m(*best), glm::dvec2(0.0));
  target_->bold = true;
  return true;
}

core::VelocityCommand SearchPolicy::explore(const Now& now) {
  if (replan_due(now)) {
    if (!replan_explore(now)) {
      follower_.clear();
      target_.reset();
      escalate(now);
      return {};
    }
  }
  if (hopeless(now)) {
    selector_.blacklist(target_->position_m);
    target_.reset();
    replan_.demand();
    return {};
  }
  if (follower_.arrived(now.pose)) {
    state_ = State::kLook;
    return look(now);
  }
  return follower_.follow(now.pose, cost_);
}

void SearchPolicy::escalate(const Now& now) {
  if (const MappedObject* object = best_tentative(now)) {
    begin_navigate(object->id);
    return;
  }
  if (effort_ == Effort::kBoldAgain) {
    stop(core::StopReason::kNoFrontierLeft);
    return;
  }
  effort_ = static_cast<Effort>(static_cast<int>(effort_) + 1);
  cost_fresh_ = false;
  replan_.demand();
  selector_.clear_blacklist();
  looked_at_m_.reset();
  if (effort_ == Effort::kSweep) {
    if (field_.begin(cost_, cost_.frame().cell_at(now.position_m))) {
      sweep_.begin(spread_places(cost_, field_, sweep_.places_left()), now.time_ns);
    }
    if (sweep_.place_m()) state_ = State::kSweep;
  }
}

}  // namespace segsim::nav::internal
