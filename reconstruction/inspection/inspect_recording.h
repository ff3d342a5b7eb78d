#pragma once

/// @file
/// What is wrong with a recording, or will be hard about it, before anything is reconstructed.

#include <string>
#include <vector>

#include "reconstruction/inspection/finding.h"
#include "reconstruction/inspection/recording_sample.h"

namespace segsim::reconstruction {

/// All checks, those that defeat a reconstruction first. A recording in which nothing stands
/// out has no findings.
/// @param sample  Of that sequence.
[[nodiscard]] std::vector<Finding> inspect_recording(const RgbdSequence& sequence,
                                                     const RecordingSample& sample);

/// Only what must hold before hours of training begin, from few frames: poses and depth have
/// the right direction and unit, no frame is there twice, and there are enough.
/// @throws InputError if a frame cannot be read.
[[nodiscard]] std::vector<Finding> inspect_briefly(const RgbdSequence& sequence);

}  // namespace segsim::reconstruction
