#pragma once

/// @file
/// Depth that several views agree on. Each view was matched by itself; what is wrong in one is
/// seldom wrong in the same way in another.

#include <cstdint>
#include <span>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"

namespace segsim::reconstruction::internal {

/// What one view found by itself.
struct MatchedView {
  core::Image<float> inverse_m;  ///< [1/m], NaN = nothing.
  core::CameraPose T_world_camera;
  float step_inverse_m = 0.0F;  ///< Between planes of its sweep.
};

/// A pixel is kept if at least `fewest` other views see its point at their own depth, and no
/// fewer than look through it. Its depth is the mean of all that agree. Depths agree that
/// differ by less than a step of the sweep, within 1 ... 3 % of the inverse depth. Patches of
/// less than 1 / 2500 of the picture are removed.
/// @param others  Indices of views.
/// @return  Depth along +z [m], NaN where there is none.
[[nodiscard]] core::Image<float> agreed_depth(std::size_t reference,
                                              std::span<const std::uint32_t> others,
                                              std::span<const MatchedView> views,
                                              const core::CameraIntrinsics& camera,
                                              int fewest);

}  // namespace segsim::reconstruction::internal
