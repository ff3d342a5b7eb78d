#pragma once

/// @file
/// What poses, names and time stamps tell without any image.

#include <vector>

#include "reconstruction/inspection/finding.h"
#include "reconstruction/inspection/recording_sample.h"

namespace segsim::reconstruction {

/// Frames with the time stamp or the name of the one before.
[[nodiscard]] std::vector<Finding> find_repeated_frames(const RgbdSequence& sequence);

/// Times (or numbers in the names of frames) that are left out while the camera moved.
[[nodiscard]] std::vector<Finding> find_frame_gaps(const RgbdSequence& sequence,
                                                   const RecordingSample& sample);

/// Steps after which little of the view before is still seen; with time stamps also speeds at
/// which a camera in somebody's hand blurs. Photographs, and pictures from one place after
/// another, have no such steps: see are_single_views().
[[nodiscard]] std::vector<Finding> find_fast_camera(const RgbdSequence& sequence,
                                                    const RecordingSample& sample);

/// Whether more than a quarter of the steps leave the view before.
[[nodiscard]] bool are_single_views(const RgbdSequence& sequence,
                                    const RecordingSample& sample);

}  // namespace segsim::reconstruction
