#pragma once

/// @file
/// What matching looks at: a recording's pictures, grey and small, with their cameras.

#include <cstdint>
#include <vector>

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"

namespace segsim::reconstruction::internal {

/// One picture at working size. All views of a recording have one camera.
struct WorkingView {
  /// 256 times the mean of the recorded pixels' grey (0 ... 65280).
  core::Image<std::uint16_t> grey;
  core::CameraPose T_world_camera;
  /// Points of the recording's own sparse reconstruction that it saw, camera frame [m].
  std::vector<glm::vec3> points_m;
};

/// The smaller picture: means of the recorded pixels' luma.
[[nodiscard]] core::Image<std::uint16_t> grey_of(const core::Image<core::Rgb8>& rgb,
                                                 int width_px, int height_px);

/// The mean of factor x factor pixels; what is left over at the right and below is cut off.
[[nodiscard]] core::Image<std::uint16_t> shrunk(const core::Image<std::uint16_t>& grey,
                                                int factor);

/// From pixels of one view to those of another: a point that the first sees at pixel (x, y)
/// with inverse depth w has the homogeneous position a (x, y, 1) + w b in the second, whose
/// third component is (depth there) / (depth here).
struct ViewWarp {
  glm::mat3 a;
  glm::vec3 b;  ///< [px m]; its third component [m].
};

[[nodiscard]] ViewWarp warp_between(const core::CameraPose& T_world_from,
                                    const core::CameraPose& T_world_to,
                                    const core::CameraIntrinsics& camera);

}  // namespace segsim::reconstruction::internal
