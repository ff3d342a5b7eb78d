#pragma once

#include <vector>

#include "reconstruction/internal/tensors/tensors.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"

namespace segsim::reconstruction::internal {

/// The first surfel in the row of each pixel, on the host; -1 = an empty row.
/// @param weights  Of this device.
[[nodiscard]] std::vector<std::int64_t> first_surfels(const PixelWeights& weights,
                                                      const at::Device& device);

}  // namespace segsim::reconstruction::internal
