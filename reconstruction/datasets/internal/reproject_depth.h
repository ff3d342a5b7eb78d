#pragma once

/// @file
/// A depth image as another camera would have measured it.

#include "core/camera.h"
#include "core/image.h"
#include "reconstruction/datasets/color_depth.h"

namespace segsim::reconstruction::internal {

/// Every pixel of `depth_m` is a small quadrangle of its surface; what is nearest to the other
/// camera wins. Quadrangles of one surface share their corners, so that no cracks open;
/// between surfaces (steps of 8 % of the depth) there is nothing. A surface that only the
/// other camera sees has no depth.
/// @param depth_m  Along +z of `from`, NaN = none; size of `from`.
/// @return Along +z of `to`, NaN = none; size of `to`.
[[nodiscard]] core::Image<float> reproject_depth(const core::Image<float>& depth_m,
                                                 const core::CameraIntrinsics& from,
                                                 const CameraToCamera& T_to_from,
                                                 const core::CameraIntrinsics& to);

}  // namespace segsim::reconstruction::internal
