#pragma once

/// @file
/// How late the clock of the poses is against that of the pictures. A picture moves against
/// the one before as the camera moves; poses and depth predict by how much. Where the camera
/// quickens and slows, only poses of the right time predict what pictures show.

#include <cstddef>
#include <string>

#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction {

struct PoseTimeFit {
  double offset_s = 0.0;  ///< To be added to the stamps of poses.
  double error_s = 0.0;   ///< Standard error, by fits without a quarter of the recording.
  /// Mean difference of predicted and seen motion from picture to picture, as poses are
  /// stamped, at the offset, and at the middle one of all offsets [px of a picture 160 wide].
  double given_px = 0.0, best_px = 0.0, usual_px = 0.0;
  std::size_t pairs = 0;
  std::string doubt;  ///< Why it must not be trusted; empty if it may be.

  /// Trusted, and more than pictures cannot tell from nothing.
  [[nodiscard]] bool is_off() const;
  [[nodiscard]] std::string text() const;
};

/// Looks at up to 24 stretches of a dozen pictures, at offsets of up to 0.25 s either way.
/// @param sequence  With times and a pose_track().
/// @throws InputError if a frame cannot be read.
[[nodiscard]] PoseTimeFit fit_pose_time(const RgbdSequence& sequence);

}  // namespace segsim::reconstruction
