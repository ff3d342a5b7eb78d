#pragma once

/// @file
/// Depth of a frame, from its file to the view of the colour image.

#include "core/camera.h"
#include "core/image.h"
#include "reconstruction/datasets/internal/file_sequence.h"

namespace segsim::reconstruction::internal {

/// Along +z of the view of the colour image, NaN = none; empty if the frame has none. Flying
/// pixels are removed, lenses straightened, and depth of another camera or another time is
/// reprojected.
[[nodiscard]] core::Image<float> read_depth(const FrameFiles& frame,
                                            const SequenceParts& parts);

}  // namespace segsim::reconstruction::internal
