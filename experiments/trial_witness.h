#pragma once

/// @file
/// Watches a trial with the ground truth in hand: what the camera saw of the goal, what the
/// detector made of it, and, in the end, why the trial failed. The policy is not asked and
/// does not know.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "core/stages.h"
#include "experiments/failure_cause.h"
#include "sim/success_profile.h"
#include "sim/trial.h"
#include "sim/world.h"

namespace segsim::experiments {

/// What is stored of a trial besides its result. -1: never; unset: not known.
struct Attribution {
  std::string cause;  ///< to_string(Cause); empty: the trial is older than attribution.
  int inevitable_tick = -1, decisive_tick = -1;
  // Perception.
  int visible_frames = 0;   ///< With the goal in view.
  int detected_frames = 0;  ///< Of these, with a true detection: recall is the quotient.
  int true_detections = 0, false_detections = 0;  ///< Of the goal's class, over all frames.
  int first_true_tick = -1;                       ///< First true detection.
  int true_clouds = 0, false_clouds = 0;          ///< Objects in the policy's map at the end.
  // The end, for success rules other than the run's own (sim/success_profile.h).
  bool stopped = false;
  int final_visible_px = 0;
  std::optional<double> object_m, planar_m, shortest_object_m;  ///< Unset: not reachable.
  int collision_ticks = 0;    ///< Control periods cut short by a contact (B1's count).
  int off_navmesh_ticks = 0;  ///< Without a finite distance to the goal.
  int reached_instance = 0;   ///< Of a success: the instance whose view point is nearest.

  [[nodiscard]] bool known() const { return !cause.empty(); }
};

/// One detection of the goal's class.
struct JudgedDetection {
  int tick = 0;
  core::BoxPx box;
  float score = 0.0F;
  bool is_goal = false;
};

/// A detection is true if its box overlaps that of a goal instance's pixels by
/// IoU >= kTrueIou, or if at least kTrueShare of its own pixels are goal pixels (a part of a
/// large object, or an object with stray pixels elsewhere).
inline constexpr float kTrueIou = 0.3F;
inline constexpr double kTrueShare = 0.5;
/// A place that the policy drives to counts as a goal's if it lies so near to a goal's box, an
/// object of its map if it lies so near.
inline constexpr double kTargetReach_m = 1.0, kCloudReach_m = 0.5;

class TrialWitness {
 public:
  /// @param goal_index  Of the goal among the detector's classes; -1: it has none.
  TrialWitness(const core::SceneManifest& manifest, const sim::Episode& episode,
               int goal_index);

  /// To be called at most once per tick, in order, with labels in the frame. A tick that was
  /// left out saw nothing. With simulated latency the detections in use are older than the
  /// frame, so on a turning robot they are judged against a scene that has moved.
  void add(int tick, const core::Frame& frame, std::span<const core::Detection> detections);

  [[nodiscard]] const std::vector<TickEvidence>& evidence() const { return evidence_; }
  [[nodiscard]] const std::vector<JudgedDetection>& detections() const { return detections_; }

 private:
  struct Seen {
    std::uint16_t instance = 0;
    int pixels = 0;
    core::BoxPx box;
  };
  [[nodiscard]] std::vector<Seen> goals_in(const core::Frame& frame) const;
  [[nodiscard]] bool is_goal(const core::BoxPx& box, const core::Frame& frame,
                             std::span<const Seen> goals) const;

  std::uint16_t class_id_ = 0;
  int goal_index_;
  std::vector<TickEvidence> evidence_;
  std::vector<JudgedDetection> detections_;
};

/// What attribution needs besides the witness; borrowed.
struct AttributionContext {
  const sim::World* world = nullptr;
  const core::SceneManifest* manifest = nullptr;
  const sim::Episode* episode = nullptr;
  const sim::SuccessProfile* profile = nullptr;
  int goal_index = -1;
  double time_limit_s = 0.0;
};

/// Everything there is to say about a finished trial, and the distance to the goal at each
/// tick.
[[nodiscard]] Attribution attribute(const AttributionContext& context,
                                    const sim::TrialResult& result,
                                    const TrialWitness& witness,
                                    std::vector<double>* distance_m = nullptr);

/// The end of a stored trial as the rules of other profiles want it.
[[nodiscard]] sim::TrialEnd trial_end(const Attribution& why,
                                      std::optional<double> distance_to_goal_m, int contacts,
                                      double sim_s, double path_m, double shortest_path_m);

}  // namespace segsim::experiments
