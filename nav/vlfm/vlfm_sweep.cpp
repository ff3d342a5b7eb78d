/// What the fixed rules do when no frontier is left: visit places that were seen only from
/// afar, and go on with a narrower inflation.

#include <algorithm>

#include <glm/geometric.hpp>

#include "nav/vlfm/internal/vlfm_search.h"

namespace segsim::nav::internal {
namespace {

constexpr double kNarrower_m = 0.01;  // The follower's circle, than the planner's.

}  // namespace

/// Nothing is left to do. The search goes on where the robot fits only just: beside a table
/// the full inflation encloses it.
/// @return  False if it did so with every inflation.
bool VlfmSearch::squeeze_through() {
  if (squeezes_ == options_.tight_radii_m.size() || options_.sweep.most_places <= 0) {
    return false;
  }
  // Where the planner leads the follower must dare to go.
  FollowerOptions narrow = options_.follower;
  narrow.footprint_radius_m =
      std::min(narrow.footprint_radius_m, options_.tight_radii_m[squeezes_] - kNarrower_m);
  follower_ = PathFollower(narrow);
  ++squeezes_;
  vetoed_m_.clear();
  if (squeezes_ == options_.tight_radii_m.size()) {
    // A touch blocks a disc ahead, which may close a gap that could be passed in its middle.
    obstacles_.forget_blocked();
    recovery_.forget_places();
  }
  sweep_.forget_visited();
  postponed_until_ns_ = 0;
  replan_.demand();
  chooser_.reset();
  // What was put off may be in view.
  sweep_spinning_ = true;
  begin_spin();
  return true;
}

/// Whether the search goes in circles: it may have a goal in sight that no way leads to, or a
/// camera that measures nothing.
bool VlfmSearch::nothing_new(const Now& now) {
  return options_.sweep.most_places > 0 &&
         seen_near_.nothing_new_for(options_.give_up_s, now.time_ns);
}

/// The reachable place around which most was seen only from afar.
std::optional<glm::dvec2> VlfmSearch::next_sweep_place(const Now& now) {
  if (sweep_.place_m() || sweep_.places_left() <= 0) return sweep_.place_m();
  refresh_cost_map();
  if (!field_.begin(cost_, cost_.frame().cell_at(now.position_m))) return std::nullopt;
  const std::optional<glm::dvec2> place_m = seen_near_.place_to_look_from(
      cost_, field_, [&](const glm::dvec2& p_m) { return sweep_.visited(p_m); });
  if (place_m) sweep_.begin({*place_m}, now.time_ns);
  return place_m;
}

core::VelocityCommand VlfmSearch::sweep_to(const Now& now, const glm::dvec2& place_m) {
  const bool arrived = glm::distance(place_m, now.position_m) <
                       options_.follower.goal_tolerance_m + 0.5 * options_.actions.forward_m;
  if (arrived || sweep_.late(now.time_ns)) {
    sweep_.leave(now.time_ns);
    sweep_spinning_ = arrived;
    begin_spin();
    follower_.clear();
    return {};
  }
  const core::VelocityCommand command = drive(now, place_m, false);
  // No way there after all.
  const bool moving = follower_.has_path() || executor_.busy();
  if (!moving) sweep_.leave(now.time_ns);
  return command;
}

}  // namespace segsim::nav::internal
