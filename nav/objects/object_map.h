#pragma once

/// @file
/// Detections of the goal class, lifted to 3-D and gathered into objects with evidence for and
/// against. Follows VLFM's object map where it can (largest cluster, far detections are second
/// class, refuted when seen from near without detection) and differs: objects are kept apart
/// and have integer ids (quirk Q12), clouds are thinned (Q11), evidence is counted per view.
/// A box also holds parts of other things; what a later box of the object leaves out although
/// it is in plain view is cut off the cloud again.

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <glm/vec3.hpp>

#include "core/stages.h"

namespace segsim::nav {

struct ObjectMapOptions {
  double box_shrink = 0.35;          ///< Share of width and height cut off the box as a whole.
  double max_range_m = 6.0;          ///< Farther pixels are not used.
  double trusted_range_m = 4.75;     ///< VLFM: 0.95 of the limit; beyond, only tentative.
  double voxel_m = 0.04;             ///< Thinning before clustering and of the stored cloud.
  double cluster_distance_m = 0.15;  ///< PCL Euclidean clustering; VLFM: DBSCAN eps 0.2 m.
  int min_cluster_points = 5;        ///< After thinning.
  int max_box_samples = 2500;        ///< Pixels looked at per box (VLFM: 5000).
  double floor_height_m = 0.05;      ///< Points below are floor, not object.
  /// A detection is not believed if one of another class with a higher score covers it by this
  /// much (intersection over union): the same thing under its better name; 1 = always
  /// believed.
  double rival_iou = 0.5;
  double association_m = 0.5;      ///< Planar gap between a detection's centre and an object's
                                   ///< cloud up to which they are the same.
  double min_move_m = 0.10;        ///< A view counts again after moving this far ...
  double min_turn_rad = 0.17;      ///< ... or turning this much (10 degrees) ...
  double min_repeat_s = 0.5;       ///< ... or, at a weight of 1/2, after this time.
  double confirm_sightings = 2.5;  ///< Weighted views that confirm, and
  double confirm_score_sum = 1.2;  ///< sum of scores over the same views.
  double visible_share = 0.6;      ///< Of the object's points, to expect a detection.
  double occlusion_margin_m = 0.25;  ///< Depth nearer than a point by this much hides it.
  double refute_range_m = 2.5;       ///< VLFM: half of the depth limit.
  double refute_margin = 3.0;  ///< Unseen views beyond `refute_ratio` x sightings that refute.
  double refute_ratio = 4.0;   ///< A detector that finds one view in five is believed.
  double revive_sightings = 6.0;        ///< New views that bring a refuted object back, once.
  std::size_t max_cloud_points = 4000;  ///< Per object.
};

enum class ObjectStatus : std::uint8_t { kTentative, kConfirmed, kRefuted };

struct MappedObject {
  int id = 0;  ///< Counts up from 0 within the episode.
  ObjectStatus status = ObjectStatus::kTentative;
  glm::dvec3 center_m{0.0};                 ///< Mean of the cloud, Odom.
  glm::dvec3 low_m{0.0}, high_m{0.0};       ///< Extent of the cloud (10 % .. 90 % per axis).
  std::vector<glm::vec3> cloud_m;           ///< Thinned surface points, Odom.
  std::vector<core::DetectionRef> made_of;  ///< Detections that gave points to the cloud.
  double sightings = 0.0;                   ///< Weighted views with a detection.
  double score_sum = 0.0;                   ///< Scores times the same weights.
  double misses = 0.0;  ///< Weighted views that should have shown it and did not.
  float best_score = 0.0F;
  double best_range_m = 1e9;  ///< Nearest range it was seen from; the cloud comes from there.
  bool trusted = false;       ///< Seen from within trusted_range_m.
  int times_refuted = 0;
  double sightings_at_refute = 0.0;
  core::TimeNs last_seen_ns = 0;  ///< Any detection, counted as a view or not.
  /// Planar distance from a place to the nearest point of the cloud [m].
  [[nodiscard]] double planar_distance_m(const glm::dvec2& p_odom_m) const;
  /// The cloud's nearest point to a place, in the plane.
  [[nodiscard]] glm::dvec2 nearest_point_m(const glm::dvec2& p_odom_m) const;
};

/// A detection lifted to 3-D.
struct LiftedDetection {
  std::vector<glm::vec3> cloud_m;  ///< Largest cluster, thinned, Odom.
  glm::dvec3 center_m{0.0};
  double range_m = 0.0;  ///< Median depth of the cluster.
  float score = 0.0F;
};

/// Largest cluster of depth points inside the shrunken box that is consistent with the box's
/// median depth; empty cloud if nothing usable is there.
[[nodiscard]] LiftedDetection lift_detection(const core::Observation& observation,
                                             const core::Detection& detection,
                                             const ObjectMapOptions& options);

class ObjectMap {
 public:
  explicit ObjectMap(const ObjectMapOptions& options = {});
  void reset();
  /// Fuses the detections of one image. @param detections  All of them; others than
  /// `class_index` are ignored.
  void update(const core::Observation& observation,
              std::span<const core::Detection> detections, int class_index);
  /// Declares an object wrong: it was looked at from near and not found.
  void refute(int id);
  [[nodiscard]] const std::vector<MappedObject>& objects() const { return objects_; }
  /// nullptr if there is no such object.
  [[nodiscard]] const MappedObject* find(int id) const;

 private:
  struct ViewPose {
    glm::dvec2 position_m{0.0};
    double yaw_rad = 0.0;
    core::TimeNs time_ns = -1;  ///< -1: no such view yet.
  };
  /// Weight of one more view of an object after the last counted one: 1, 1/2 or 0.
  [[nodiscard]] double view_weight(const ViewPose& last, const ViewPose& now) const;
  std::size_t object_for(const LiftedDetection& lifted);
  void add_sighting(std::size_t index, const LiftedDetection& lifted,
                    const core::Observation& observation, const core::BoxPx& box,
                    const ViewPose& now);
  void count_misses(const core::Observation& observation, const ViewPose& now,
                    const std::vector<bool>& seen_now);
  void update_status(MappedObject& object) const;

  ObjectMapOptions options_;
  std::vector<MappedObject> objects_;
  std::vector<ViewPose> last_hit_, last_miss_;  ///< Per object.
};

}  // namespace segsim::nav
