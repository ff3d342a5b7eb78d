#pragma once

/// @file
/// A guess of the depth where the sensor measured none: glass, black plastic, what is too far.

#include "core/image.h"

namespace segsim::renderer {

/// Measured depth stays; every other pixel takes what its surroundings have, from as near as
/// there is any (push and pull over a pyramid of means: Gortler et al., "The Lumigraph",
/// 1996).
/// @param depth_m  Measured where it is in (min_m, max_m).
/// @return  Of the same size; all NaN if nothing was measured.
[[nodiscard]] core::Image<float> completed_depth_m(const core::Image<float>& depth_m,
                                                   double min_m, double max_m);

}  // namespace segsim::renderer
