#pragma once

/// @file
/// VLFM's object map: one cloud for all instances of the target
/// class. Per detection: erode the mask, take at most 5000 of its points, keep the largest
/// DBSCAN cluster, reject what is nearer than 1 m; points within 95 % of the depth range are
/// trusted, the others and whole detections at the image's side edge are second class.
/// Second-class detections that come into clear range and view without being confirmed are
/// deleted.
///
/// nav/objects/object_map.h is the other notion: separate instances with counted evidence.

#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <glm/vec3.hpp>

#include "core/random.h"
#include "core/stages.h"
#include "nav/mapping/vlfm_rules.h"
#include "nav/objects/internal/voxel_set.h"

namespace segsim::nav {

struct ClassCloudOptions {
  int erosion_passes = 5;  ///< 3 x 3; at images of 640 px width, fewer for narrower ones.
  int max_points = 5000;
  double cluster_eps_m = 0.2;
  int cluster_min_points = 100;  ///< At 640 x 480 px, fewer for smaller images.
  double max_depth_m = 5.0;
  double trusted_share = 0.95;  ///< Of max_depth_m.
  double edge_share = 0.05;  ///< A mask that touches this much of the left or right edge ...
  double edge_third = 1.0 / 3.0;  ///< ... and lies wholly in that third is second class.
  double too_close_m = 1.0;
  double refute_share = 0.5;  ///< Of max_depth_m.
  double voxel_m = 0.02;      ///< Fixed Q11: one point per voxel and detection class.
  std::size_t most_points = 2'000'000;  ///< Published Q11 grows for ever; here up to this.
  /// Not in VLFM (0: as there): lower points are floor, not object.
  double floor_m = 0.0;
  /// Not in VLFM (0: as there): points this near to a new detection and in plain view, yet
  /// beside every box of the class, were taken for the object by mistake and are deleted.
  double carve_m = 0.0;
  /// Not in VLFM (0: as there): a point is a target only if the 0.75 m around it hold at least
  /// this share of what the densest 0.75 m hold. A clump in mid-air has a few points.
  double support_share = 0.0;
  // Hysteresis of the target.
  double keep_below_m = 0.1;  ///< Smaller moves keep the previous target ...
  double keep_far_below_m = 0.5,
         far_m = 2.0;  ///< ... or these, while it is farther than far_m.
};

/// A point with the detection that it came from.
struct CloudPoint {
  glm::vec3 p_odom_m{0.0F};
  std::uint32_t source = 0;     ///< Counts the detections that were kept.
  std::uint64_t detection = 0;  ///< kTrusted, or an id of its second-class detection.
};

/// Points that hang together: what people would call an object.
struct CloudGroup {
  glm::dvec2 center_m{0.0};  ///< Mean of the points, Odom.
  std::vector<core::DetectionRef> made_of;
};

class ClassCloud {
 public:
  static constexpr std::uint64_t kTrusted = 0;

  explicit ClassCloud(const ClassCloudOptions& options = {},
                      const VlfmRules& rules = VlfmRules(), std::uint64_t seed = 0);
  void reset(std::uint64_t seed);
  /// Adds one detection. @param box  It is remembered by; see CloudGroup::made_of.
  /// @return  Whether anything of it was kept.
  bool add(const core::Observation& observation, const core::Image<std::uint8_t>& mask,
           const core::BoxPx& box = {});
  /// To be called after the detections of an image were added, with their boxes; see
  /// ClassCloudOptions::carve_m.
  void carve(const core::Observation& observation, std::span<const core::BoxPx> boxes);
  /// To be called after the detections of an image were added: deletes second-class detections
  /// of which a point lies within range and opening of the camera now.
  void refute_second_class(const core::Observation& observation);
  /// Deletes every point within a planar distance: it was looked at and found wrong.
  void erase_around(const glm::dvec2& place_odom_m, double radius_m);
  /// Where to go: the supported point nearest to the robot now, trusted ones first, with
  /// hysteresis; nullopt without points.
  [[nodiscard]] std::optional<glm::dvec3> target_m(const glm::dvec2& robot_odom_m);
  [[nodiscard]] const std::vector<CloudPoint>& points() const { return points_; }
  /// The cloud in parts: points whose squares of 0.25 m touch belong together.
  [[nodiscard]] std::vector<CloudGroup> groups() const;

 private:
  std::vector<glm::vec3> masked_points(const core::Observation& observation,
                                       const core::Image<std::uint8_t>& mask,
                                       const glm::ivec2& corner_px);
  std::uint64_t new_id();
  void store(const CloudPoint& point);
  /// Deletes the points for which `wrong` holds.
  template <class Wrong>
  void erase(const Wrong& wrong);
  void find_candidates();

  ClassCloudOptions options_;
  VlfmRules rules_;
  std::vector<CloudPoint> points_;
  std::vector<core::DetectionRef> sources_;  ///< By CloudPoint::source.
  internal::VoxelSet voxels_;                ///< That have a point; fixed Q11 only.
  bool changed_ = false;                     ///< points_, since the last target_m().
  std::vector<std::uint32_t> candidates_;    ///< Of points_, that may be targets.
  std::optional<glm::dvec3> last_target_m_;
  core::RandomStream random_;
  std::uint64_t detections_ = 0;
  /// Extents of the clusters of one image.
  std::vector<std::pair<glm::vec3, glm::vec3>> fresh_m_;
  std::vector<std::uint32_t> pixels_;  ///< Scratch: those of one mask.
};

}  // namespace segsim::nav
