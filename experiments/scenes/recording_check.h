#pragma once

/// @file
/// What `segsim reconstruct --check` prints, and what stops `segsim reconstruct`.

#include <filesystem>

#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::experiments::scenes {

/// Prints what will be hard about the recording, one line each, to standard output, and draws
/// where its cameras looked.
/// @param picture  PNG.
/// @throws InputError if a frame cannot be read, or the picture cannot be written.
void check_recording(const reconstruction::RgbdSequence& sequence,
                     const std::filesystem::path& picture);

/// Wrong units and inverted poses, which would spoil everything that is made of the recording.
/// @param insisted  The user has stated unit and direction of the poses: only warn.
/// @throws InputError naming the flag that helps.
void refuse_wrong_poses(const reconstruction::RgbdSequence& sequence, bool insisted);

}  // namespace segsim::experiments::scenes
