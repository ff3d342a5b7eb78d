#pragma once

/// @file
/// Where surfels are added and taken away while geometry is trained.
///
/// The start is dense and opaque (lifting), so this is not the densification of 2DGS: nothing
/// is cloned in place and opacities are never reset. Surfels that the images pull at are split
/// along their longer axis, within a budget; views with depth where nothing is drawn get new
/// surfels; surfels that no view needs go.

#include <cstdint>
#include <span>
#include <unordered_set>
#include <vector>

#include <glm/vec3.hpp>

#include "reconstruction/training/raw_surfels.h"
#include "reconstruction/training/training_config.h"
#include "reconstruction/training/training_set.h"

namespace segsim::reconstruction {

/// What is known of every surfel since the last change; all of one length.
struct SurfelStatistics {
  std::vector<float> gradient;    ///< Mean screen gradient over the views that show it.
  std::vector<float> max_weight;  ///< Over all views.
  std::vector<float> opacity;
  std::vector<float> long_scale_m, short_scale_m;
};

/// The surfels to split: gradient above the threshold, strongest first (ties: lower index), as
/// many as growth and budget allow. Ascending.
[[nodiscard]] std::vector<std::int64_t> surfels_to_split(
    const SurfelStatistics& statistics, const GeometryConfig::Densify& config);

/// The surfels that stay: opaque enough, needed in a view, not larger than the scene allows.
/// Ascending.
[[nodiscard]] std::vector<std::int64_t> surfels_to_keep(const SurfelStatistics& statistics,
                                                        const GeometryConfig::Densify& config,
                                                        double extent_m);

/// Two surfels in place of one: centres 0.6 sigma to both sides along the longer axis, whose
/// scale becomes 0.7 of what it was, the other's 0.9: the pair covers what the one covered, a
/// little tighter (0.6^2 + 0.7^2 = 0.85 of the variance).
/// @param raw  Changed to the first halves.  @return  The second halves.
[[nodiscard]] RawSurfels split_surfels(RawSurfels& raw);

/// Collects surfels for places that a view sees and the surfels do not show.
class HoleFiller {
 public:
  /// Pixels that are drawn with less alpha are holes.
  static constexpr float kHoleAlpha = 0.5F;

  /// @param voxel_m  At most one new surfel in each.
  HoleFiller(double voxel_m, int sh_degree) : voxel_m_(voxel_m) {
    pending_.sh_degree = sh_degree;
  }

  /// Every second pixel of every second row with alpha < kHoleAlpha gives a surfel as large as
  /// the pixels where a depth in (min, max) says, facing as the depth's normals say.
  /// Where none was measured there is none: surfels at guessed depths stand in the way of
  /// other views (docs/results/reconstruction.md).
  /// @param T_world_camera  Of the view: training may have moved it.
  /// @param alpha  [height, width] of the view as drawn.
  void add_view(const TrainingView& view, const core::CameraPose& T_world_camera,
                const core::CameraIntrinsics& intrinsics, std::span<const float> alpha,
                double min_depth_m, double max_depth_m);

  /// What was collected since the last take().
  [[nodiscard]] const RawSurfels& pending() const { return pending_; }
  /// Goes on from a pending() of before.
  void restore(RawSurfels pending);
  /// The collected surfels, at most `most` (the first ones), and forgets all.
  [[nodiscard]] RawSurfels take(std::int64_t most);

 private:
  void add(const glm::vec3& position_m, const glm::vec3& normal, double size_m,
           const core::Rgb8& rgb);

  double voxel_m_;
  std::unordered_set<std::int64_t> places_;  ///< Voxels that are taken.
  RawSurfels pending_;
};

}  // namespace segsim::reconstruction
