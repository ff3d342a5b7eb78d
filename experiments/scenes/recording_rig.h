#pragma once

/// @file
/// Offsets between colour, depth and poses that are to be found in the recording itself.

#include <filesystem>

#include "experiments/specs/rig_spec.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::experiments::scenes {

/// Options with all that `rig` states and all that it wants found: first the clock of the
/// poses, then the place and the clock of the depth camera together. Prints one line for each;
/// what is too small to be told from nothing stays as it is.
/// @param save  Where a depth camera's place that was found is written (color_depth.h); empty:
///     nowhere.
/// @throws core::InputError if the recording cannot be read, or does not tell for sure.
[[nodiscard]] reconstruction::SequenceOptions with_rig(const std::filesystem::path& recording,
                                                       reconstruction::SequenceOptions options,
                                                       const specs::RigSpec& rig,
                                                       const std::filesystem::path& save = {});

}  // namespace segsim::experiments::scenes
