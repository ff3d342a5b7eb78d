#pragma once

/// @file
/// What fusion leaves to repair: floaters, and surfaces several voxels thick where poses
/// drift.

#include <cstddef>
#include <span>
#include <vector>

#include "reconstruction/lifting/internal/voxel_fusion.h"

namespace segsim::reconstruction::internal {

/// Depth images that say which space was empty.
class FreeSpace {
 public:
  /// Loads `count` of the given frames, evenly spread.
  FreeSpace(const RgbdSequence& sequence, std::span<const std::size_t> frames, int count,
            const LiftOptions& options);

  struct Evidence {
    int through = 0;  ///< Frames that saw a surface clearly behind the point.
    int support = 0;  ///< Frames that saw a surface at the point.
  };
  [[nodiscard]] Evidence at(const glm::vec3& position_m) const;

 private:
  struct View {
    core::CameraIntrinsics camera;
    glm::mat3 R_camera_world;
    glm::vec3 position_m;
    core::Image<float>
        depth_m;  ///< Nearest of the 3x3 pixels; NaN where fewer than 5 are valid.
  };
  float max_depth_m_;
  std::vector<View> views_;
};

/// Removes voxels that more frames saw through than saw. @return number removed.
std::size_t carve(std::vector<Voxel>& voxels, const FreeSpace& free_space, float voxel_m);

/// Moves each centre of mass onto the plane of its neighbourhood (5x5x5 voxels that face the
/// same way) and merges voxels: one round of moving least squares (Alexa et al. 2001) on the
/// grid.
[[nodiscard]] std::vector<Voxel> thin_surfaces(const std::vector<Voxel>& voxels,
                                               float voxel_m);

/// Removes voxels with too few observations. @return number removed.
std::size_t remove_sparse(std::vector<Voxel>& voxels, int min_observations);

/// Removes groups of voxels that touch (26 neighbours) with less than `fewest` members.
/// @return number removed.
std::size_t remove_islands(std::vector<Voxel>& voxels, std::size_t fewest);

}  // namespace segsim::reconstruction::internal
