#pragma once

#include <torch/types.h>

#include <vector>

#include "core/stages.h"
#include "perception/internal/centernet/network.h"

namespace segsim::perception::centernet {

/// The peaks of each image whose score reaches the threshold: a cell is a peak of a class if
/// none of its eight neighbours has a higher logit of that class. Boxes in pixels of the
/// input, by ascending row, column and class.
/// @param maps  On the CPU, float.
[[nodiscard]] std::vector<std::vector<core::Detection>> peaks_on_host(const HeatMaps& maps,
                                                                      float score_threshold);

/// The same by tensor operations where the maps lie; only the peaks travel to the host.
[[nodiscard]] std::vector<std::vector<core::Detection>> peaks_on_device(const HeatMaps& maps,
                                                                        float score_threshold);

}  // namespace segsim::perception::centernet
