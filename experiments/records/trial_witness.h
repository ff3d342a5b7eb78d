#pragma once

/// @file
/// Watches a trial with the ground truth in hand: what the camera saw of the goal, what the
/// detector made of it, and, in the end, why the trial failed. The policy is not asked and
/// does not know.

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "core/stages.h"
#include "experiments/records/failure_cause.h"
#include "sim/ground/world.h"
#include "sim/trial/goal_objects.h"
#include "sim/trial/success_profile.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::records {

/// What is stored of a trial besides its result. -1: never; unset: not known.
struct Attribution {
  std::optional<Cause> cause;  ///< None: the trial is older than attribution.
  int inevitable_tick = -1, decisive_tick = -1;
  // Perception: of the images that the policy decided on, each counted once.
  int images = -1;          ///< Their number; -1: not known (trials of older versions).
  int visible_frames = 0;   ///< With the goal in view.
  int detected_frames = 0;  ///< Of these, with a true detection: recall is the quotient.
  int true_detections = 0, false_detections = 0;  ///< Of the goal's class, over all images.
  int first_true_tick = -1;                       ///< First true detection.
  // Objects in the policy's map at the end: at a goal; elsewhere, made of false detections;
  // elsewhere, although made of true ones (-1: not known, they are among the false ones).
  int true_clouds = 0, false_clouds = 0, misplaced_clouds = -1;
  // The end, for success rules other than the run's own (sim/trial/success_profile.h).
  bool stopped = false;
  int final_visible_px = 0;
  std::optional<double> object_m, planar_m, shortest_object_m;  ///< Unset: not reachable.
  int collision_ticks = 0;    ///< Control periods cut short by a contact (B1's count).
  int off_navmesh_ticks = 0;  ///< Without a finite distance to the goal.
  int reached_instance = 0;   ///< Of a success: the instance whose view point is nearest.
  /// Views that the detector was tuned on, near where the trial ended, that show the goal's
  /// class; -1: not known, or nothing was tuned here.
  int stop_views = -1;

  [[nodiscard]] bool known() const { return cause.has_value(); }
};

/// One detection of the goal's class.
struct JudgedDetection {
  int tick = 0;  ///< At which the policy took it in.
  core::BoxPx box;
  float score = 0.0F;
  bool is_goal = false;
  std::uint64_t capture_index = 0;  ///< Of its image; not stored in logs.
};

/// A detection is true if its box overlaps that of a goal instance's pixels by
/// IoU >= kTrueIou, or if at least kTrueShare of its own pixels are goal pixels (a part of a
/// large object, or an object with stray pixels elsewhere).
inline constexpr float kTrueIou = 0.3F;
inline constexpr double kTrueShare = 0.5;
/// A place that the policy drives to counts as a goal's if it lies so near to a goal's box, an
/// object of its map if it lies so near. An object that lies farther off is misplaced if most
/// of the detections that it is made of were true (TrialWitness::mostly_true()): the box was
/// right, its depth was another thing's. Otherwise it is false: the detector's own mistake.
inline constexpr double kTargetReach_m = 1.0, kCloudReach_m = 0.5;
/// How near a view is to where a trial ended (Attribution::stop_views).
inline constexpr double kStopRegion_m = 0.5;

/// What the detector made of one image.
struct ImageEvidence {
  int largest_px = 0;  ///< Of the goal instance seen best in that image.
  int true_detections = 0, false_detections = 0;
  std::vector<JudgedDetection> detections;  ///< Of the goal's class; no tick yet.
};

class TrialWitness {
 public:
  /// @param goal_index  Of the goal among the detector's classes; -1: it has none.
  TrialWitness(const core::SceneManifest& manifest, const sim::Episode& episode,
               int goal_index);

  /// The detector's answer to an image, with the labels of that image.
  void judge(std::uint64_t capture_index, const core::Frame& frame,
             std::span<const core::Detection> detections);
  /// To be called at most once per tick, in order. A tick that was left out saw nothing.
  /// @param newest  What the camera saw last, with labels.
  /// @param decided_on  The image that the policy took in at this tick, which is older if
  /// perception takes time; none if it had no new one. Was judged before.
  void add(int tick, const core::Frame& newest, std::optional<std::uint64_t> decided_on);

  [[nodiscard]] const std::vector<TickEvidence>& evidence() const { return evidence_; }
  /// The images that the policy decided on, in that order.
  [[nodiscard]] const std::vector<ImageEvidence>& images() const { return images_; }
  [[nodiscard]] const std::vector<JudgedDetection>& detections() const { return detections_; }
  /// Whether at least half of these detections were true; false without any that is known.
  [[nodiscard]] bool mostly_true(std::span<const core::DetectionRef> made_of) const;

 private:
  struct Seen {
    std::uint16_t instance = 0;
    int pixels = 0;
    core::BoxPx box;
  };
  [[nodiscard]] std::vector<Seen> goals_in(const core::Frame& frame) const;
  [[nodiscard]] bool is_goal(const core::BoxPx& box, const core::Frame& frame,
                             std::span<const Seen> goals) const;

  sim::GoalObjects goal_;
  int goal_index_;
  std::vector<TickEvidence> evidence_;
  std::vector<JudgedDetection> detections_;
  std::vector<ImageEvidence> images_;
  std::map<std::uint64_t, ImageEvidence> on_their_way_;  ///< By capture.
};

/// Stands before a detector and its sink of ground truth, and has the witness judge each
/// answer by the labels of its own image.
class WitnessedDetector final : public core::Detector, public sim::GroundTruthSink {
 public:
  /// @param truth  Of the detector; may be null.
  WitnessedDetector(core::Detector& inner, sim::GroundTruthSink* truth, TrialWitness& witness)
      : inner_(inner), truth_(truth), witness_(witness) {}
  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return inner_.class_names();
  }
  void begin_episode(const sim::Episode& episode) override;
  void set_truth(const core::Frame& frame) override;
  [[nodiscard]] std::vector<core::Detection> detect(const core::Observation& seen) override;

 private:
  core::Detector& inner_;
  sim::GroundTruthSink* truth_;
  TrialWitness& witness_;
  const core::Frame* frame_ = nullptr;  ///< Of the call of detect() that follows.
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

/// A place of the policy's map (Odom) in World. Odometry drifts; the transform is that of the
/// end, so this is where the robot would arrive if it drove there now.
[[nodiscard]] glm::dvec2 world_from_odom(const sim::TrialResult& result,
                                         const glm::dvec2& p_odom_m);

/// Everything there is to say about a finished trial, and the distance to the goal at each
/// tick.
[[nodiscard]] Attribution attribute(const AttributionContext& context,
                                    const sim::TrialResult& result,
                                    const TrialWitness& witness,
                                    std::vector<double>* distance_m = nullptr);

/// The end of a trial as the rules of other profiles want it.
[[nodiscard]] sim::TrialEnd trial_end(const Attribution& why, const sim::TrialResult& result);

}  // namespace segsim::experiments::records
