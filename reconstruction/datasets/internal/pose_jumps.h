#pragma once

/// @file
/// Places in a camera path where the poses cannot be right.

#include <cstddef>
#include <span>
#include <vector>

#include "core/frames.h"
#include "reconstruction/datasets/internal/file_sequence.h"

namespace segsim::reconstruction::internal {

/// A step is a jump if it is longer than 0.5 m and 20 times the middle one of the path, or
/// turns by more than 60 degrees and 20 times the middle one. Where more than a quarter of the
/// steps are jumps, or a tenth are breaks, or with fewer than 8 poses, there are none:
/// photographs, or pictures from one place after another, and not a walk.
struct PoseJumps {
  /// Poses far from both neighbours, which are near each other: tracking erred for one frame.
  std::vector<std::size_t> lone;
  /// The other jumps, by the pose before: tracking was lost, or recordings were joined.
  std::vector<std::size_t> breaks;
};

[[nodiscard]] PoseJumps find_pose_jumps(std::span<const core::CameraPose> path);

/// A lone pose is a broken frame, as accept_frame() treats it; breaks are warnings.
void check_pose_jumps(SequenceParts& parts, OnBadFrame on_bad_frame);

}  // namespace segsim::reconstruction::internal
