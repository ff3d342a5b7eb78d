#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "nav/planning/approach.h"
#include "nav/vlfm/internal/vlfm_search.h"

namespace segsim::nav::internal {
namespace {

constexpr double kBoxMargin = 0.1;      // Of the image's width, around a box seen again.
constexpr double kWrongObject_m = 0.6;  // What is deleted around an object not seen again.
constexpr double kDetour_m = 15.0;      // Way that open floor to the object is worth.
constexpr double kInside_m = 0.15;      // A place this much nearer than a radius is within it.
constexpr double kBeyondWeight = 1000.0;
constexpr double kObjectRadius_m = 0.8;  // The cloud holds all objects of the class.
constexpr double kBehind_m = 0.6;        // An object that begins this far behind is elsewhere.
constexpr double kSamePlace_m = 0.3;
constexpr core::TimeNs kPostpone_ns = 15 * core::kNsPerSecond;

}  // namespace

/// The cheapest reachable cell within the stop radius of the object, or the reachable one that
/// is nearest to it.
std::optional<glm::dvec2> VlfmSearch::place_beside(const Now& now,
                                                   const glm::dvec2& object_m) {
  const GridFrame& frame = cost_.frame();
  if (!field_.begin(cost_, frame.cell_at(now.position_m))) return std::nullopt;
  const double enough_m = options_.stop_radius_m - kInside_m;
  // Every metre beyond the radius outweighs any way inside of a building: look nearby first.
  for (double within_m = options_.distances.limit_m + 0.5;; within_m *= 2.0) {
    const CellBox window =
        CellBox{frame.cell_at(object_m - within_m), frame.cell_at(object_m + within_m)}
            .clipped_to(field_.reachable_box());
    std::optional<Cell> best;
    double best_cost = std::numeric_limits<double>::infinity();
    for (int j = window.low.y; j <= window.high.y; ++j) {
      for (int i = window.low.x; i <= window.high.x; ++i) {
        if (!field_.reachable({i, j})) continue;
        const glm::dvec2 place_m = frame.center_m({i, j});
        const double away_m = glm::distance(place_m, object_m);
        const double beyond = kBeyondWeight * std::max(0.0, away_m - enough_m);
        if (beyond >= best_cost) continue;
        double cost = static_cast<double>(field_.cost_m(i, j)) + beyond;
        if (cost >= best_cost) continue;
        // Across a counter or behind a wall the object is near, yet not at hand.
        if (away_m <= options_.distances.limit_m && !open_floor(cost_, place_m, object_m)) {
          cost += kDetour_m;
        }
        if (cost < best_cost) {
          best_cost = cost;
          best = Cell(i, j);
        }
      }
    }
    const bool all = window == field_.reachable_box();
    if (!all && best_cost >= kBeyondWeight * (within_m - enough_m)) continue;
    if (!best) return std::nullopt;
    return frame.center_m(*best);
  }
}

/// The part of the cloud that belongs to the object at a point, as nav/planning/approach.h
/// wants it.
MappedObject VlfmSearch::object_at(const glm::dvec2& object_m) const {
  MappedObject object;
  for (const CloudPoint& point : cloud_.points()) {
    if (glm::distance(glm::dvec2(point.p_odom_m), object_m) > kObjectRadius_m) continue;
    object.cloud_m.push_back(point.p_odom_m);
  }
  if (object.cloud_m.empty()) object.cloud_m.emplace_back(object_m.x, object_m.y, 0.5);
  object.low_m = object.high_m = object.center_m = object.cloud_m.front();
  glm::dvec3 sum(0.0);
  for (const glm::vec3& p : object.cloud_m) {
    object.low_m = glm::min(object.low_m, glm::dvec3(p));
    object.high_m = glm::max(object.high_m, glm::dvec3(p));
    sum += glm::dvec3(p);
  }
  object.center_m = sum / static_cast<double>(object.cloud_m.size());
  return object;
}

/// Where to drive to look at the object: as near as the success rule wants it, across open
/// floor where there is such a place, and not so near that it drops out of the image.
std::optional<glm::dvec2> VlfmSearch::approach_place(const Now& now,
                                                     const glm::dvec2& object_m) {
  if (!field_.begin(cost_, cost_.frame().cell_at(now.position_m))) return std::nullopt;
  const MappedObject object = object_at(object_m);
  const auto [min_m, max_m, limit_m] =
      approach_range(options_.distances, view_distance_m(*now.observation, object),
                     verification_.looks_from_afar(kTheObject));
  const auto place = choose_approach(cost_, field_, object, min_m, max_m, limit_m);
  // One that is too far away still leads nearer, and shows more of the floor around it.
  if (!place) return std::nullopt;
  return place->position_m;
}

/// Drives to a place beside the object and looks; the radius alone does not end the way.
core::VelocityCommand VlfmSearch::approach(const Now& now, const glm::dvec3& object_m) {
  const glm::dvec2 at_m(object_m);
  // Another object than the one that was looked at.
  if (glm::distance(at_m, now.position_m) >= options_.distances.limit_m) verification_.end();
  if (verification_.active()) return look_again(now, object_m);
  if (options_.motion == Motion::kDiscrete || replan_due(now) || !target_m_) {
    refresh_cost_map();
    const auto place_m = approach_place(now, at_m);
    // The best place changes a little with every view; a neighbour of the old one is no news.
    if (!place_m || !target_m_ || glm::distance(*target_m_, *place_m) > kSamePlace_m ||
        !field_.reachable(cost_.frame().cell_at(*target_m_))) {
      target_m_ = place_m;
    }
    replan_.demand();
  }
  const auto postpone = [&] {  // Out of reach: go on exploring, it may be seen again.
    cloud_.erase_around(at_m, kWrongObject_m);
    postponed_until_ns_ = now.time_ns + kPostpone_ns;
    target_m_.reset();
    follower_.clear();
    return core::VelocityCommand{};
  };
  if (!target_m_) return postpone();
  const double arrived_m =
      options_.follower.goal_tolerance_m +
      (options_.motion == Motion::kDiscrete ? 0.5 * options_.actions.forward_m : 0.0);
  if (glm::distance(*target_m_, now.position_m) <= arrived_m) {
    const bool near = glm::distance(at_m, now.position_m) <= options_.distances.limit_m;
    return near ? look_again(now, object_m) : postpone();
  }
  return drive(now, *target_m_, false);
}

core::VelocityCommand VlfmSearch::navigate(const Now& now, const glm::dvec3& object_m) {
  if (options_.approach) return approach(now, object_m);
  const double rho_m = glm::distance(glm::dvec2(object_m), now.position_m);
  // Another target than the one that was looked at.
  if (rho_m >= options_.distances.limit_m) verification_.end();
  if (verification_.active() || rho_m < options_.stop_radius_m) {
    if (options_.second_look) return look_again(now, object_m);
    stop(core::StopReason::kGoalReached);
    return {};
  }
  if (options_.motion == Motion::kDiscrete || replan_due(now) || !target_m_) {
    refresh_cost_map();
    target_m_ = place_beside(now, glm::dvec2(object_m));
    replan_.demand();
  }
  const bool as_published = options_.rules.published(Quirk::kNoRecovery);
  const bool arrived =
      target_m_ && glm::distance(*target_m_, now.position_m) <
                       options_.follower.goal_tolerance_m + 0.5 * options_.actions.forward_m;
  if (!as_published && (!target_m_ || arrived)) {
    // As near as it gets: good enough, or nothing that can be reached.
    if (arrived && rho_m < options_.distances.limit_m) return look_again(now, object_m);
    cloud_.erase_around(glm::dvec2(object_m), kWrongObject_m);
    return {};
  }
  if (!target_m_) return {};
  return drive(now, *target_m_, false);
}

/// Whether what the box shows begins where the object was thought to be; else something stood
/// before the object when it was mapped.
bool VlfmSearch::at_its_place(const Now& now, const core::BoxPx& box,
                              const glm::dvec3& object_m) const {
  if (!options_.approach) return true;
  const core::Image<float>& depth_m = *now.observation->depth_m;
  const core::Image<std::uint8_t> mask = options_.segmenter->segment(*now.observation, box);
  const auto T = now.observation->T_odom_camera();
  std::vector<double> away_m;
  for (int y = 0; y < mask.height_px(); y += 2) {
    for (int x = 0; x < mask.width_px(); x += 2) {
      if (mask(x, y) == 0 || !(depth_m(x, y) > 0.0F)) continue;
      const glm::dvec3 p =
          T.rotation() * now.observation->intrinsics.back_project(
                             {x + 0.5, y + 0.5}, static_cast<double>(depth_m(x, y))) +
          T.translation_m();
      away_m.push_back(glm::distance(glm::dvec2(p), now.position_m));
    }
  }
  if (away_m.empty()) return true;  // Too near to measure, or a hole.
  const auto front = away_m.begin() + static_cast<std::ptrdiff_t>(away_m.size() / 10);
  std::nth_element(away_m.begin(), front, away_m.end());
  return *front < glm::distance(glm::dvec2(object_m), now.position_m) + kBehind_m;
}

bool VlfmSearch::seen_now(const Now& now, const glm::dvec3& object_m) const {
  const glm::dvec3 p =
      (now.observation->T_odom_camera().inverse() * core::Point<core::frame::Odom>{object_m})
          .xyz_m;
  if (!(p.z > 0.05)) return false;
  const double u = now.observation->intrinsics.project(p).x;
  const double margin = kBoxMargin * now.observation->intrinsics.width_px;
  return std::any_of(now.detections.begin(), now.detections.end(),
                     [&](const core::Detection& d) {
                       return d.class_index == goal_.class_index &&
                              static_cast<double>(d.score) >= options_.min_score &&
                              u > static_cast<double>(d.box.x0) - margin &&
                              u < static_cast<double>(d.box.x1) + margin &&
                              at_its_place(now, d.box, object_m);
                     });
}

core::VelocityCommand VlfmSearch::look_again(const Now& now, const glm::dvec3& object_m) {
  if (!options_.second_look) {
    stop(core::StopReason::kGoalReached);
    return {};
  }
  if (!verification_.active()) verification_.begin(now.time_ns);
  const double bearing =
      std::atan2(object_m.y - now.position_m.y, object_m.x - now.position_m.x);
  const double error = core::wrap_angle_rad(bearing - now.pose.yaw_rad);
  const bool facing = verification_.faces(error);
  switch (verification_.look(now.time_ns, error, facing && seen_now(now, object_m))) {
    case Verdict::kSeen:
      stop(core::StopReason::kGoalReached);
      return {};
    case Verdict::kLooking:
      return facing && std::abs(error) < 0.05 ? core::VelocityCommand{} : face(now, bearing);
    case Verdict::kNotSeen:
      break;
  }
  if (!options_.approach || !verification_.look_from_afar(kTheObject)) {
    cloud_.erase_around(glm::dvec2(object_m), kWrongObject_m);
    verification_.forget_far_looks();
  }
  verification_.end();
  target_m_.reset();
  follower_.clear();
  return {};
}

}  // namespace segsim::nav::internal
