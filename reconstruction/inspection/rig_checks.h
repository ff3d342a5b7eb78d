#pragma once

/// @file
/// Do colour, depth and poses belong to one place and one time?

#include <vector>

#include "reconstruction/inspection/finding.h"
#include "reconstruction/inspection/recording_sample.h"

namespace segsim::reconstruction {

/// A depth camera that stands apart from the colour camera, or depth images of another time.
/// @param calibration  What find_wrong_calibration() found about the same edges: its help is
///     completed instead of a second line.
[[nodiscard]] std::vector<Finding> find_depth_offset(const RgbdSequence& sequence,
                                                     const RecordingSample& sample,
                                                     std::vector<Finding> calibration);

/// Poses of another time than the pictures. Looks at some three hundred frames more.
[[nodiscard]] std::vector<Finding> find_late_poses(const RgbdSequence& sequence);

}  // namespace segsim::reconstruction
