#pragma once

/// @file
/// One depth for every pixel out of its matching costs: semi-global matching (Hirschmueller,
/// PAMI 2008), along eight directions, on planes of a sweep instead of disparities.

#include "core/image.h"
#include "reconstruction/stereo/internal/plane_sweep.h"

namespace segsim::reconstruction::internal {

/// In units of CostVolume::cost.
struct SmoothnessPenalties {
  int one_plane = 7;     ///< Of a step to the next plane.
  int many_planes = 45;  ///< Of any larger step; less across edges of the picture.
  int fewest_many = 14;  ///< But never less than this.
};

/// @param guide  The reference, of the volume's size: where it has edges, depth may jump.
/// @return  Inverse depth [1/m], between planes by a parabola through three costs. NaN where
///     the best plane costs as much as another that is more than two planes away.
[[nodiscard]] core::Image<float> semi_global(const CostVolume& volume,
                                             const core::Image<std::uint16_t>& guide,
                                             const SmoothnessPenalties& penalties = {});

}  // namespace segsim::reconstruction::internal
