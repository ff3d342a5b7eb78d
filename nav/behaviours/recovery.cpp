#include "nav/behaviours/recovery.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "core/random.h"

namespace segsim::nav {

Recovery::Recovery(const RecoveryOptions& options, double robot_radius_m)
    : options_(options), robot_radius_m_(robot_radius_m), stuck_(options.stuck) {}

void Recovery::reset(std::uint64_t seed) {
  *this = Recovery(options_, robot_radius_m_);
  seed_ = seed;
}

void Recovery::watch(const core::Pose2& pose, const core::VelocityCommand& command,
                     bool blocked) {
  stuck_.add(pose, command);
  blocked_ = blocked ? blocked_ + 1 : 0;
}

void Recovery::forget_motion() {
  stuck_.reset();
  blocked_ = 0;
}

bool Recovery::due() const {
  if (active_) return false;
  const bool blocked = options_.blocked_decisions > 0 && blocked_ > options_.blocked_decisions;
  return blocked || stuck_.stuck();
}

std::optional<FeltDisc> Recovery::felt(const Moment& now) const {
  if (!stuck_.stuck()) return std::nullopt;
  const auto before =
      std::count_if(places_m_.begin(), places_m_.end(), [&](const glm::dvec2& place_m) {
        return glm::distance(place_m, now.position_m) < options_.same_place_m;
      });
  const glm::dvec2 ahead(std::cos(now.pose.yaw_rad), std::sin(now.pose.yaw_rad));
  const double radius_m = options_.felt_m + options_.felt_more_m * static_cast<double>(before);
  return FeltDisc{now.position_m + (robot_radius_m_ + options_.felt_beyond_m) * ahead,
                  std::min(radius_m, options_.felt_most_m)};
}

std::optional<FeltDisc> Recovery::begin(const Moment& now) {
  const std::optional<FeltDisc> disc = felt(now);
  places_m_.push_back(now.position_m);
  core::RandomStream random(seed_, options_.random_stream, static_cast<std::uint64_t>(count_));
  const double turn_rad = random.uniform(options_.turn_min_rad, options_.turn_max_rad);
  yaw_rad_ = now.pose.yaw_rad + (random.chance(0.5) ? turn_rad : -turn_rad);
  ++count_;
  active_ = true;
  turning_ = false;
  start_ = now.pose;
  since_ns_ = now.time_ns;
  forget_motion();
  return disc;
}

std::optional<core::VelocityCommand> Recovery::command(const Moment& now,
                                                       const PathFollower& follower,
                                                       const CostMap& map) {
  const bool late = core::seconds(now.time_ns - since_ns_) >= options_.phase_s;
  const core::VelocityCommand turn =
      follower.turn_to(now.pose, yaw_rad_, options_.turn_tolerance_rad);
  if (turning_) {
    if (turn.turn_radps != 0.0 && !late) return turn;
    active_ = false;
    return std::nullopt;
  }
  const double backed_m = std::hypot(now.pose.x_m - start_.x_m, now.pose.y_m - start_.y_m);
  const core::VelocityCommand back{-options_.back_mps, 0.0};
  if (backed_m < options_.back_m && !late &&
      (!options_.back_where_safe || follower.safe(now.pose, back, map))) {
    return back;
  }
  turning_ = true;
  since_ns_ = now.time_ns;
  return turn;
}

}  // namespace segsim::nav
