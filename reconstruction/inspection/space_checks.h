#pragma once

/// @file
/// What depth and poses tell together: is there a floor, do loops close?

#include <vector>

#include <glm/vec3.hpp>

#include "reconstruction/inspection/finding.h"
#include "reconstruction/inspection/recording_sample.h"

namespace segsim::reconstruction {

/// World points of the sampled depth, at most `most` of them, nearer than 6 m.
[[nodiscard]] std::vector<glm::vec3> sample_points_m(const RecordingSample& sample,
                                                     std::size_t most);

/// No large horizontal plane below the cameras.
[[nodiscard]] std::vector<Finding> find_unseen_floor(const RecordingSample& sample);

/// Frames far apart along the path that look at the same place from nearby, and see it
/// elsewhere.
[[nodiscard]] std::vector<Finding> find_open_loops(const RgbdSequence& sequence,
                                                   const RecordingSample& sample);

}  // namespace segsim::reconstruction
