#pragma once

/// @file
/// What the sampled images tell: blur, holes in depth, calibration.

#include <vector>

#include "reconstruction/inspection/finding.h"
#include "reconstruction/inspection/recording_sample.h"

namespace segsim::reconstruction {

/// Places in sample.frames that are blurred against the recording's own median.
[[nodiscard]] std::vector<std::size_t> blurred_samples(const RecordingSample& sample);
[[nodiscard]] std::vector<Finding> find_blur(const RgbdSequence& sequence,
                                             const RecordingSample& sample);

[[nodiscard]] std::vector<Finding> find_depth_holes(const RgbdSequence& sequence,
                                                    const RecordingSample& sample);

/// Depth whose edges fit those in colour clearly better when it is shifted or scaled.
[[nodiscard]] std::vector<Finding> find_wrong_calibration(const RgbdSequence& sequence,
                                                          const RecordingSample& sample);

}  // namespace segsim::reconstruction
