#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "nav/frontier/internal/search_policy.h"

namespace segsim::nav::internal {
namespace {

constexpr double kViewSlack_m =
    0.10;                        // Stop a little before the object sinks out of the image.
constexpr int kMaxReplaced = 3;  // Verifications that end with "seen, but farther away".

}  // namespace

/// The nearest confirmed object among those not postponed.
const MappedObject* SearchPolicy::best_object(const Now& now) const {
  const MappedObject* best = nullptr;
  for (const MappedObject& object : objects_.objects()) {
    if (object.status != ObjectStatus::kConfirmed) continue;
    if (postponed_until_ns_[static_cast<std::size_t>(object.id)] > now.time_ns) continue;
    // Nearest first, as VLFM; evidence only decides whether an object is confirmed.
    if (best == nullptr ||
        object.planar_distance_m(now.position_m) < best->planar_distance_m(now.position_m)) {
      best = &object;
    }
  }
  return best;
}

/// The most promising object that was not refuted, confirmed or not, postponed or not.
const MappedObject* SearchPolicy::best_tentative(const Now&) const {
  const MappedObject* best = nullptr;
  for (const MappedObject& object : objects_.objects()) {
    if (object.status == ObjectStatus::kRefuted || object.cloud_m.empty()) continue;
    if (best == nullptr || object.score_sum > best->score_sum) best = &object;
  }
  return best;
}

void SearchPolicy::begin_navigate(int id) {
  state_ = State::kNavigate;
  object_id_ = id;
  target_.reset();
  follower_.clear();
  replan_.demand();
  replaced_verifications_ = 0;
  approach_rank_ = ApproachRank::kNone;
}

double SearchPolicy::stop_distance_m(const Now& now, const MappedObject& object) const {
  const double visible_m = view_distance_m(*now.observation, object) + kViewSlack_m;
  return std::clamp(visible_m, options_.stop_distance_m, options_.distances.limit_m);
}

double SearchPolicy::facing_error_rad(const Now& now, const MappedObject& object) const {
  // Halfway between the nearest point and the middle: a long sofa is faced where the robot is.
  const glm::dvec2 aim =
      0.5 * (object.nearest_point_m(now.position_m) + glm::dvec2(object.center_m)) -
      now.position_m;
  return core::wrap_angle_rad(std::atan2(aim.y, aim.x) - now.pose.yaw_rad);
}

bool SearchPolicy::recently_seen(const Now& now, const MappedObject& object) const {
  return core::seconds(now.time_ns - object.last_seen_ns) <= options_.recent_detection_s;
}

bool SearchPolicy::at_goal(const Now& now, const MappedObject& object) const {
  return object.status == ObjectStatus::kConfirmed &&
         object.planar_distance_m(now.position_m) < stop_distance_m(now, object) &&
         verification_.faces(facing_error_rad(now, object)) && recently_seen(now, object) &&
         open_floor(cost_, now.position_m, object.nearest_point_m(now.position_m));
}

/// Verification failed. An object that many views showed gets a second look from farther away.
void SearchPolicy::give_up_object() {
  const MappedObject& object = *objects_.find(object_id_);
  if (object.sightings >= options_.second_look_sightings &&
      verification_.look_from_afar(object_id_)) {
    begin_navigate(object_id_);
    return;
  }
  objects_.refute(object_id_);
  object_id_ = -1;
  resume_search();
}

ApproachRange SearchPolicy::range_of(const Now& now, const MappedObject& object) const {
  return approach_range(options_.distances, view_distance_m(*now.observation, object),
                        verification_.looks_from_afar(object_id_));
}

/// The way to the old place, if that is to be kept: the best one changes a little with every
/// view.
std::optional<Path> SearchPolicy::way_to_old_place(const Now& now, const MappedObject& object,
                                                   const ApproachRange& range,
                                                   const ApproachPlace& better,
                                                   ApproachRank rank) {
  if (!target_ || !follower_.has_path() || rank < approach_rank_) return std::nullopt;
  if (glm::distance(target_->position_m, better.position_m) >= 1.0) return std::nullopt;
  const CostMap& map = rank == ApproachRank::kOpenBeyondUnknown ? bold_ : cost_;
  if (!map.traversable(map.frame().cell_at(target_->position_m))) return std::nullopt;
  if (rank == ApproachRank::kOpen &&
      !open_floor(map, target_->position_m, object.nearest_point_m(target_->position_m))) {
    return std::nullopt;
  }
  const double to_object_m = object.planar_distance_m(target_->position_m);
  const bool near = to_object_m >= range.min_m - options_.distances.arrival_m &&
                    to_object_m <= (rank == ApproachRank::kFar ? range.limit_m : range.max_m);
  if (!near) return std::nullopt;
  return plan_path(map, now.position_m, target_->position_m, &planner_);
}

bool SearchPolicy::replan_navigate(const Now& now, const MappedObject& object) {
  replan_.planned(now.time_ns);
  const ApproachRange range = range_of(now, object);
  const auto choose = [&](const CostMap& map) -> std::optional<ApproachPlace> {
    if (!field_.begin(map, map.frame().cell_at(now.position_m))) return std::nullopt;
    auto place = choose_approach(map, field_, object, range.min_m, range.max_m, range.limit_m);
    if (place && place->to_object_m > range.limit_m) place.reset();
    return place;
  };
  const auto near = [&](const std::optional<ApproachPlace>& place) {
    return place && place->line_of_sight && place->to_object_m <= range.max_m;
  };
  std::optional<ApproachPlace> place = choose(cost_);
  ApproachRank rank = ApproachRank::kNone;
  if (near(place) && place->open_floor) {
    rank = ApproachRank::kOpen;
  } else {
    // The known floor ends too far away or behind something: perhaps the unknown leads nearer.
    build_bold_map();
    const std::optional<ApproachPlace> beyond = choose(bold_);
    const double known_cost_m = near(place) ? place->cost_m : 0.0;
    if (near(beyond) && beyond->open_floor &&
        (!near(place) || beyond->cost_m < known_cost_m + options_.detour_m)) {
      place = beyond;
      rank = ApproachRank::kOpenBeyondUnknown;
    } else if (near(place)) {
      rank = ApproachRank::kInSight;
    } else if (place && (frontiers_.empty() || effort_ != Effort::kNormal)) {
      rank = ApproachRank::kFar;  // Only when there is nothing else to find out.
    } else {
      return false;
    }
  }
  const CostMap& map = rank == ApproachRank::kOpenBeyondUnknown ? bold_ : cost_;
  const auto old_way = way_to_old_place(now, object, range, *place, rank);
  const glm::dvec2 to_m = old_way ? target_->position_m : place->position_m;
  if (old_way) {
    follower_.set_path(*old_way);
  } else if (!drive_to(now, to_m, map)) {
    return false;
  }
  approach_rank_ = rank;
  track_target(now, to_m, glm::dvec2(0.0));
  return true;
}

core::VelocityCommand SearchPolicy::navigate(const Now& now) {
  const MappedObject* object = objects_.find(object_id_);
  if (object == nullptr || object->status == ObjectStatus::kRefuted) {
    resume_search();
    return {};
  }
  if (at_goal(now, *object)) {
    stop(core::StopReason::kGoalReached);
    return {};
  }
  if ((replan_due(now) && !replan_navigate(now, *object)) || hopeless(now)) {
    // Not reachable (yet): go on exploring and come back; when nothing else is left, forget
    // it.
    auto& until_ns = postponed_until_ns_[static_cast<std::size_t>(object_id_)];
    if (until_ns >= 0 && frontiers_.empty()) {
      objects_.refute(object_id_);
    }
    until_ns = now.time_ns + static_cast<core::TimeNs>(options_.postpone_s * 1e9);
    resume_search();
    return {};
  }
  if (follower_.arrived(now.pose)) {
    state_ = State::kVerify;
    verification_.begin(now.time_ns);
    return verify(now);
  }
  return follower_.follow(now.pose, cost_);
}

core::VelocityCommand SearchPolicy::verify(const Now& now) {
  const MappedObject* object = objects_.find(object_id_);
  if (object == nullptr || object->status == ObjectStatus::kRefuted) return navigate(now);
  const double distance_m = object->planar_distance_m(now.position_m);
  const double error = facing_error_rad(now, *object);
  const bool recent = recently_seen(now, *object);
  const bool confirmed = object->status == ObjectStatus::kConfirmed;
  // Where nothing nearer is reachable the wider limit holds.
  const bool far = approach_rank_ == ApproachRank::kFar;
  const double enough_m = (far ? options_.distances.limit_m : range_of(now, *object).max_m) +
                          options_.distances.arrival_m;
  const bool seen = recent && object->last_seen_ns >= verification_.since_ns() && confirmed &&
                    distance_m <= enough_m;
  // A tentative object that is being seen right now gets the time to be confirmed.
  switch (verification_.look(now.time_ns, error, seen, recent ? 2.0 : 1.0)) {
    case Verdict::kSeen:
      stop(core::StopReason::kGoalReached);
      return {};
    case Verdict::kLooking:
      return follower_.turn_to(now.pose, now.pose.yaw_rad + error, 0.1);
    case Verdict::kNotSeen:
      break;
  }
  if (confirmed && recent && verification_.faces(error) &&
      ++replaced_verifications_ < kMaxReplaced) {
    // Seen, but its nearest point turned out to lie farther away: go on driving.
    const int rounds = replaced_verifications_;
    begin_navigate(object_id_);
    replaced_verifications_ = rounds;
  } else {
    give_up_object();
  }
  return {};
}

}  // namespace segsim::nav::internal
