#pragma once

/// @file
/// How sharp a picture is.

#include "core/image.h"

namespace segsim::reconstruction {

struct ImageDetail {
  /// Variance of the Laplacian of the brightness [grey levels squared]: high in sharp
  /// pictures, low in blurred ones, but also where there is nothing to see.
  double sharpness = 0.0;
  /// The same, divided by that of the picture at a quarter of its size: low where large
  /// structures are there and small ones are not, which is what blur makes.
  double fine_share = 0.0;
};

[[nodiscard]] ImageDetail measure_detail(const core::Image<core::Rgb8>& rgb);

}  // namespace segsim::reconstruction
