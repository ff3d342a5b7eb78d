#include "experiments/records/trial_witness.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "experiments/drawing/odom_placement.h"

namespace segsim::experiments::records {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kObjectReach_m = 1.0;  // As far as semexp-gibson grows the object.

std::optional<double> finite(double value) {
  return std::isfinite(value) ? std::optional<double>(value) : std::nullopt;
}

/// Centres of the free cells within kObjectReach_m of a goal's box.
std::vector<glm::dvec2> places_at_goal(const AttributionContext& context,
                                       const sim::GoalObjects& goal) {
  const sim::FreeSpace& space = context.world->free_space();
  std::vector<glm::dvec2> places;
  for (int j = 0; j < space.frame.height; ++j) {
    for (int i = 0; i < space.frame.width; ++i) {
      if (space.free(i, j) == 0) continue;
      const glm::dvec2 p_m =
          space.frame.origin_m + space.frame.cell_m * (glm::dvec2(i, j) + 0.5);
      if (distance_to_goal_box_m(*context.manifest, goal, p_m) <= kObjectReach_m) {
        places.push_back(p_m);
      }
    }
  }
  return places;
}

/// What the policy went for in the end: its target, or the object that it knows nearest to the
/// robot. Nothing if it explored.
std::optional<glm::dvec2> final_target(const sim::TrialResult& result, int goal_index) {
  if (result.track.empty()) return std::nullopt;
  const sim::TickRecord& last = result.track.back();
  const auto in_world = [&](const glm::dvec2& p_m) { return world_from_odom(result, p_m); };
  if (last.mode != core::PolicyMode::kNavigate && last.mode != core::PolicyMode::kStop) {
    return std::nullopt;
  }
  if (result.final_view.target_m) return in_world(*result.final_view.target_m);
  const glm::dvec2 robot_m(result.final_pose.x_m, result.final_pose.y_m);
  std::optional<glm::dvec2> best;
  for (const core::PolicyView::Object& object : result.final_view.objects) {
    if (object.class_index != goal_index) continue;
    const glm::dvec2 object_m = in_world(object.position_m);
    if (!best || glm::distance(object_m, robot_m) < glm::distance(*best, robot_m)) {
      best = object_m;
    }
  }
  return best;
}

double planar_to_view_point_m(const sim::Episode& episode, const glm::dvec2& p_m) {
  double best_m = kInfinity;
  for (const glm::dvec2& q_m : episode.view_points_m) {
    best_m = std::min(best_m, glm::distance(p_m, q_m));
  }
  return best_m;
}

/// The instance of the view point where the shortest way from here ends.
int instance_at(const sim::Episode& episode, const sim::DistanceField& to_goal,
                const glm::dvec2& p_m) {
  if (episode.view_point_instance.empty()) return 0;
  const std::vector<glm::dvec2> way = to_goal.path_from(p_m, sim::DistanceField::kBaseSnap_m);
  if (way.empty()) return 0;
  std::size_t best = 0;
  for (std::size_t k = 1; k < episode.view_points_m.size(); ++k) {
    if (glm::distance(episode.view_points_m[k], way.back()) <
        glm::distance(episode.view_points_m[best], way.back())) {
      best = k;
    }
  }
  return episode.view_point_instance[best];
}

void count_perception(const TrialWitness& witness, int visible_px, Attribution& why) {
  why.images = static_cast<int>(witness.images().size());
  for (const ImageEvidence& image : witness.images()) {
    const bool visible = image.largest_px >= visible_px;
    why.visible_frames += visible ? 1 : 0;
    why.detected_frames += visible && image.true_detections > 0 ? 1 : 0;
    why.true_detections += image.true_detections;
    why.false_detections += image.false_detections;
  }
  const auto first = std::find_if(witness.evidence().begin(), witness.evidence().end(),
                                  [](const TickEvidence& e) { return e.true_detections > 0; });
  if (first != witness.evidence().end()) {
    why.first_true_tick = static_cast<int>(first - witness.evidence().begin());
  }
}

bool same_box(const core::BoxPx& a, const core::BoxPx& b) {
  return a.x0 == b.x0 && a.y0 == b.y0 && a.x1 == b.x1 && a.y1 == b.y1;
}

void count_objects(const AttributionContext& context, const sim::GoalObjects& goal,
                   const sim::TrialResult& result, const TrialWitness& witness,
                   Attribution& why) {
  why.misplaced_clouds = 0;
  for (const core::PolicyView::Object& object : result.final_view.objects) {
    if (object.class_index != context.goal_index) continue;
    const double off_m = distance_to_goal_box_m(*context.manifest, goal,
                                                world_from_odom(result, object.position_m));
    if (off_m <= kCloudReach_m) {
      ++why.true_clouds;
    } else {
      ++(witness.mostly_true(object.made_of) ? why.misplaced_clouds : why.false_clouds);
    }
  }
}

}  // namespace

TrialWitness::TrialWitness(const core::SceneManifest& manifest, const sim::Episode& episode,
                           int goal_index)
    : goal_(manifest, episode), goal_index_(goal_index) {}

std::vector<TrialWitness::Seen> TrialWitness::goals_in(const core::Frame& frame) const {
  std::vector<Seen> goals;
  if (goal_.empty()) return goals;
  for (int j = 0; j < frame.semantic.height_px(); ++j) {
    for (int i = 0; i < frame.semantic.width_px(); ++i) {
      const std::uint16_t id = frame.instance(i, j);
      if (!goal_.holds(frame.semantic(i, j), id)) continue;
      auto found = std::find_if(goals.begin(), goals.end(),
                                [id](const Seen& seen) { return seen.instance == id; });
      const auto x = static_cast<float>(i), y = static_cast<float>(j);
      if (found == goals.end()) {
        found = goals.insert(goals.end(), {id, 0, {x, y, x + 1, y + 1}});
      }
      ++found->pixels;
      found->box = {std::min(found->box.x0, x), std::min(found->box.y0, y),
                    std::max(found->box.x1, x + 1), std::max(found->box.y1, y + 1)};
    }
  }
  return goals;
}

bool TrialWitness::is_goal(const core::BoxPx& box, const core::Frame& frame,
                           std::span<const Seen> goals) const {
  for (const Seen& seen : goals) {
    if (core::iou(box, seen.box) >= kTrueIou) return true;
  }
  const int x0 = std::max(0, static_cast<int>(box.x0)),
            x1 = std::min(frame.semantic.width_px(), static_cast<int>(std::ceil(box.x1)));
  const int y0 = std::max(0, static_cast<int>(box.y0)),
            y1 = std::min(frame.semantic.height_px(), static_cast<int>(std::ceil(box.y1)));
  int goal_pixels = 0;
  for (int j = y0; j < y1; ++j) {
    for (int i = x0; i < x1; ++i) {
      goal_pixels += goal_.holds(frame.semantic(i, j), frame.instance(i, j)) ? 1 : 0;
    }
  }
  const double area = static_cast<double>(std::max(0, x1 - x0)) * std::max(0, y1 - y0);
  return !goals.empty() && area > 0.0 && goal_pixels >= kTrueShare * area;
}

void TrialWitness::judge(std::uint64_t capture_index, const core::Frame& frame,
                         std::span<const core::Detection> detections) {
  const std::vector<Seen> goals = goals_in(frame);
  ImageEvidence& image = on_their_way_[capture_index] = {};
  for (const Seen& seen : goals) image.largest_px = std::max(image.largest_px, seen.pixels);
  for (const core::Detection& detection : detections) {
    if (goal_index_ < 0 || detection.class_index != goal_index_) continue;
    const bool right = is_goal(detection.box, frame, goals);
    ++(right ? image.true_detections : image.false_detections);
    image.detections.push_back({-1, detection.box, detection.score, right, capture_index});
  }
}

void TrialWitness::add(int tick, const core::Frame& newest,
                       std::optional<std::uint64_t> decided_on) {
  SEGSIM_CHECK(tick >= static_cast<int>(evidence_.size()), "ticks come in order");
  evidence_.resize(static_cast<std::size_t>(tick));
  TickEvidence evidence;
  for (const Seen& seen : goals_in(newest)) {
    if (seen.pixels <= evidence.largest_px) continue;
    evidence.largest_px = seen.pixels;
    evidence.instance = seen.instance;
  }
  if (decided_on) {
    ImageEvidence& image = on_their_way_.at(*decided_on);
    evidence.true_detections = image.true_detections;
    evidence.false_detections = image.false_detections;
    for (JudgedDetection& detection : image.detections) {
      detection.tick = tick;
      detections_.push_back(detection);
    }
    images_.push_back(std::move(image));
    // Older ones were given up, or a newer one overtook them.
    on_their_way_.erase(on_their_way_.begin(), on_their_way_.upper_bound(*decided_on));
  }
  evidence_.push_back(evidence);
}

bool TrialWitness::mostly_true(std::span<const core::DetectionRef> made_of) const {
  int right = 0, known = 0;
  for (const core::DetectionRef& ref : made_of) {
    const auto judged =
        std::find_if(detections_.begin(), detections_.end(), [&](const JudgedDetection& d) {
          return d.capture_index == ref.capture_index && same_box(d.box, ref.box);
        });
    if (judged == detections_.end()) continue;
    ++known;
    right += judged->is_goal ? 1 : 0;
  }
  return known > 0 && 2 * right >= known;
}

void WitnessedDetector::begin_episode(const sim::Episode& episode) {
  if (truth_ != nullptr) truth_->begin_episode(episode);
}

void WitnessedDetector::set_truth(const core::Frame& frame) {
  frame_ = &frame;
  if (truth_ != nullptr) truth_->set_truth(frame);
}

std::vector<core::Detection> WitnessedDetector::detect(const core::Observation& seen) {
  SEGSIM_CHECK(frame_ != nullptr, "the truth comes before the image");
  std::vector<core::Detection> detections = inner_.detect(seen);
  witness_.judge(seen.capture_index, *frame_, detections);
  frame_ = nullptr;
  return detections;
}

glm::dvec2 world_from_odom(const sim::TrialResult& result, const glm::dvec2& p_odom_m) {
  return drawing::OdomPlacement(result.final_pose, result.final_estimate).to_world(p_odom_m);
}

Attribution attribute(const AttributionContext& context, const sim::TrialResult& result,
                      const TrialWitness& witness, std::vector<double>* distance_m) {
  const sim::Episode& episode = *context.episode;
  const sim::GoalObjects goal(*context.manifest, episode);
  Attribution why;
  count_perception(witness, context.profile->visible_px, why);

  const sim::DistanceField to_goal = context.world->distance_to(episode.view_points_m);
  std::vector<double> distances;
  for (const sim::TickRecord& tick : result.track) {
    distances.push_back(
        to_goal.at({tick.pose.x_m, tick.pose.y_m}, sim::DistanceField::kBaseSnap_m));
    why.off_navmesh_ticks += std::isfinite(distances.back()) ? 0 : 1;
    why.collision_ticks += tick.in_contact ? 1 : 0;
  }
  count_objects(context, goal, result, witness, why);

  FailureFacts facts;
  facts.outcome = result.outcome;
  facts.stop_reason = result.stop_reason;
  facts.track = result.track;
  facts.evidence = witness.evidence();
  facts.distance_m = distances;
  facts.target_m = final_target(result, context.goal_index);
  facts.target_is_goal =
      facts.target_m &&
      distance_to_goal_box_m(*context.manifest, goal, *facts.target_m) <= kTargetReach_m;
  facts.visible_px = context.profile->visible_px;
  facts.time_limit_s = context.time_limit_s;
  facts.max_speed_mps = context.world->robot().max_forward_mps;
  facts.success_distance_m = context.profile->distance_m;
  facts.invalid_pixel_fraction = result.invalid_pixel_fraction;
  const Verdict verdict = judge(facts);
  why.cause = verdict.cause;
  why.inevitable_tick = verdict.inevitable_tick;
  why.decisive_tick = verdict.decisive_tick;

  if (!result.track.empty()) {
    // The last tick is older than a STOP that took its time to reach the wheels.
    const glm::dvec2 end_m(result.final_pose.x_m, result.final_pose.y_m);
    why.stopped =
        result.track.back().mode == core::PolicyMode::kStop || result.stop_reason.has_value();
    why.final_visible_px = result.final_goal_pixels;
    why.planar_m = finite(planar_to_view_point_m(episode, end_m));
    const sim::DistanceField to_object =
        context.world->distance_to(places_at_goal(context, goal));
    // Beside the object there is no way left, free cell or not.
    why.object_m = distance_to_goal_box_m(*context.manifest, goal, end_m) <= kObjectReach_m
                       ? 0.0
                       : finite(to_object.at(end_m, sim::DistanceField::kBaseSnap_m));
    why.shortest_object_m = finite(to_object.at({episode.start.x_m, episode.start.y_m}));
    if (result.success) why.reached_instance = instance_at(episode, to_goal, end_m);
  }
  if (distance_m != nullptr) *distance_m = std::move(distances);
  return why;
}

sim::TrialEnd trial_end(const Attribution& why, const sim::TrialResult& result) {
  sim::TrialEnd end;
  end.stopped = why.stopped;
  end.declared = result.stop_reason == core::StopReason::kGoalReached;
  end.view_point_m = result.distance_to_goal_m;
  end.object_m = why.object_m.value_or(kInfinity);
  end.planar_m = why.planar_m.value_or(kInfinity);
  end.visible_px = why.final_visible_px;
  end.contacts = result.contacts;
  end.time_s = result.sim_s;
  end.path_m = result.path_m;
  end.shortest_path_m = result.shortest_path_m;
  end.shortest_object_m = why.shortest_object_m.value_or(kInfinity);
  return end;
}

}  // namespace segsim::experiments::records
