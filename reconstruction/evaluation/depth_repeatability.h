#pragma once

/// @file
/// How well a depth camera agrees with itself: what it measured from one place, brought to
/// another place and compared with what it measured there. Noise of the sensor, errors of the
/// poses and of resampling are all in it, so it is the level below which an error of a
/// reconstruction against the recorded depth says nothing about the reconstruction.
///
///     depth at A --back-project--> points --T_B_A, project, nearest wins--> depth at B

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"

namespace segsim::reconstruction {

/// The depth image that a camera at B would have, from points measured at A. Each point falls
/// on one pixel; the nearest point of a pixel stays; NaN where none falls. What A's points do
/// not hide may show through between them, which counts as disagreement.
/// @param depth_m  At A; NaN or <= 0 = unknown.
[[nodiscard]] core::Image<float> reprojected_depth(const core::Image<float>& depth_m,
                                                   const core::CameraIntrinsics& intrinsics,
                                                   const core::CameraPose& T_world_a,
                                                   const core::CameraPose& T_world_b);

}  // namespace segsim::reconstruction
