#pragma once

/// @file
/// Finer depth on surfaces that do not face the camera: every pixel gets a plane of its own,
/// fitted to its neighbourhood, handed on by its neighbours and moved along the line of sight,
/// and keeps the one under which the pictures are most alike (the slanted windows of Bleyer et
/// al., BMVC 2011, with a fixed list of trials instead of random ones).

#include <span>

#include "reconstruction/stereo/internal/plane_sweep.h"

namespace segsim::reconstruction::internal {

/// @param inverse_m  [1/m], of the reference's size; NaN stays NaN.
/// @param step_inverse_m  Distance of two planes of the sweep: trials reach half of it.
void refine_slanted(const core::Image<std::uint16_t>& reference,
                    std::span<const core::Image<std::uint16_t>* const> sources,
                    std::span<const ViewWarp> warps, float step_inverse_m,
                    core::Image<float>& inverse_m);

}  // namespace segsim::reconstruction::internal
