#pragma once

/// @file
/// Which directions were looked at, from anywhere.

#include <array>
#include <vector>

#include "reconstruction/inspection/finding.h"
#include "reconstruction/inspection/recording_sample.h"

namespace segsim::reconstruction {

struct ViewDirections {
  static constexpr int kSectors = 36;
  /// Frames that see the horizon in [10 i, 10 (i + 1)) degrees from +x, counter-clockwise.
  std::array<int, kSectors> frames_of_sector{};
  double lowest_rad = 0.0, highest_rad = 0.0;  ///< Elevations that some frame sees.
};

[[nodiscard]] ViewDirections count_directions(const std::vector<core::CameraPose>& path,
                                              const core::CameraIntrinsics& intrinsics);

/// Gaps of 30 degrees or more of the horizon, nothing seen 20 degrees above or below it.
[[nodiscard]] std::vector<Finding> find_unseen_directions(const RgbdSequence& sequence,
                                                          const RecordingSample& sample);

}  // namespace segsim::reconstruction
