#pragma once

/// @file
/// Which pictures a picture is matched with: those that show the same surfaces from places far
/// enough apart to tell depth and near enough to look alike.

#include <cstdint>
#include <span>
#include <vector>

#include "core/camera.h"
#include "core/frames.h"

namespace segsim::reconstruction::internal {

/// Where the surfaces of a view are expected.
struct DepthRange {
  double near_m = 0.0, middle_m = 0.0, far_m = 0.0;
};

/// Indices of views, the best first.
struct SourceViews {
  std::vector<std::uint32_t> matched;   ///< Spread out, to match with.
  std::vector<std::uint32_t> compared;  ///< More of them, whose depth is compared.
};

/// Angle at which two lines of sight should meet: the best match has a parallax of about 25 px
/// at the middle depth, but the angle stays within 4 ... 12 degrees.
[[nodiscard]] double wanted_angle_rad(const core::CameraIntrinsics& camera);

/// A view scores, for points at three depths of a 5 x 4 grid of the reference's pixels, the
/// mean of exp(-(angle - wanted)^2 / (2 s^2)), 0 out of view; s is 0.4 of the wanted angle
/// below it and 1.2 above (the form of Goesele et al., ICCV 2007, and Yao et al., ECCV 2018).
/// Views that repeat the place of one that is chosen count less.
/// @param ranges  Of each view.
/// @param matched, compared  At most so many. Scores below 0.05 are never chosen.
[[nodiscard]] SourceViews choose_sources(std::size_t reference,
                                         std::span<const core::CameraPose> poses,
                                         std::span<const DepthRange> ranges,
                                         const core::CameraIntrinsics& camera, int matched,
                                         int compared);

}  // namespace segsim::reconstruction::internal
