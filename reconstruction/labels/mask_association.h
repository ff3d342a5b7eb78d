#pragma once

/// @file
/// Which masks of different views show one object. The id of a mask means something in its own
/// view only, but where masks lie on the surface says which of them belong together: two masks
/// do as far as the views that see both explain both by one mask of their own (view consensus:
/// MaskClustering, Yan et al., CVPR 2024). Three things are this project's: clusters are
/// joined by average linkage, void pixels count as not seen, and voxels vote afterwards, so
/// that doubled and strayed masks lose to the object they lie on.

#include <cstdint>
#include <unordered_map>
#include <vector>

#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/frame_masks.h"
#include "core/frames.h"
#include "reconstruction/labels/panoptic_config.h"

namespace segsim::reconstruction {

/// A mask by the view that it was added with, and its id there.
struct MaskOfView {
  std::int32_t view = 0;
  std::uint16_t id = 0;
  bool operator==(const MaskOfView&) const = default;
};

/// An object that masks of several views agree on.
struct AssociatedObject {
  glm::vec3 mean_m{0.0F};      ///< Of the voxels it won, world frame.
  glm::vec3 sigma_m{0.0F};     ///< Standard deviation along the axes of the world.
  std::uint16_t class_id = 0;  ///< What most of its masks say.
  std::int64_t views = 0, voxels = 0;
  /// That it won most voxels of, joined before or not; by view.
  std::vector<MaskOfView> masks;
};

class MaskAssociation {
 public:
  explicit MaskAssociation(const AssociationConfig& config);

  /// @param depth_m  Of the masks' size; NaN = unknown.
  void add_view(const core::FrameMasks& masks, const core::Image<float>& depth_m,
                const core::CameraIntrinsics& camera, const core::CameraPose& T_world_camera);

  /// Largest first. Depends on nothing but the views, in their order.
  [[nodiscard]] std::vector<AssociatedObject> objects() const;

 private:
  friend class AssociationRun;

  struct Mask {
    std::int32_t view = 0;
    std::uint16_t id = 0, class_id = 0;
    std::vector<std::int32_t> voxels;
  };
  /// What a view shows at a voxel: a mask, or -1 = a surface without one.
  struct Sighting {
    std::int32_t view, mask;
  };
  struct Voxel {
    glm::vec3 position_m{0.0F};  ///< Of the first point in it.
    std::vector<Sighting> sightings;
  };

  [[nodiscard]] std::int32_t voxel_at(const glm::dvec3& p_m);

  AssociationConfig config_;
  std::int32_t views_ = 0;
  std::vector<Mask> masks_;
  std::vector<Voxel> voxels_;
  std::unordered_map<std::uint64_t, std::int32_t> index_;  ///< Looked up, never walked.
};

}  // namespace segsim::reconstruction
