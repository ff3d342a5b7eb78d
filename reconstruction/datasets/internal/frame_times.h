#pragma once

/// @file
/// What shifted clocks change: which pose a frame has, and which depth image.

#include "reconstruction/datasets/internal/file_sequence.h"

namespace segsim::reconstruction::internal {

/// Frames get times by their numbers, if the options say so; SequenceParts::track is made of
/// the frames' poses where these have times and it is empty. With an offset, frames take the
/// pose at their time and the depth image that was measured nearest to it (and at most 0.1 s
/// away), with the camera's motion between; frames without are left out, and a note says so.
/// @throws InputError if offsets are given, but no times; a name without number; no frame
/// left.
void apply_times(SequenceParts& parts, const TimeOptions& options);

}  // namespace segsim::reconstruction::internal
