#pragma once

#include <vector>

#include "reconstruction/lifting/internal/voxel_fusion.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction::internal {

struct SurfelReport {
  std::size_t outliers = 0;      ///< Voxels left out: neighbours unusually far away.
  double label_agreement = 0.0;  ///< Mean vote share of the winners.
};

/// One surfel per voxel: normal and in-plane axes are the principal directions of the nearest
/// neighbours (PCL kd-tree), scales follow their spacing.
/// @param with_labels  Fills semantic_id and instance_id.
[[nodiscard]] renderer::SurfelCloud make_surfels(const std::vector<Voxel>& voxels,
                                                 const LiftOptions& options, bool with_labels,
                                                 SurfelReport& report);

}  // namespace segsim::reconstruction::internal
