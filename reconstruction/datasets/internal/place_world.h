#pragma once

/// @file
/// Brings a recording's own world to ours: z up, floor at z = 0. What is given by hand or by
/// the labels of a capture is taken as it is; a layout's habit stands unless surfaces and
/// cameras say otherwise (reconstruction/upright).

#include "reconstruction/datasets/internal/file_sequence.h"

namespace segsim::reconstruction::internal {

/// Moves the poses, and fills in T_world_source, placement, a note, and warnings of doubts.
void place_world(SequenceParts& parts, const WorldConvention& convention);

}  // namespace segsim::reconstruction::internal
