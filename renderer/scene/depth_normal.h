#pragma once

/// @file
/// Normals of a depth image: what geometry the depth alone tells, to compare with the normals
/// that surfels carry (the two agree in a good reconstruction; Huang et al. 2024 train on it).
///
///     normal ~ (P(x + 1) - P(x - 1)) x (P(y + 1) - P(y - 1)),   P = back-projected pixel
///
/// Along a plane 1 / depth is linear in the image at any slant, so its second difference tells
/// an edge from a grazing surface. At an edge the difference is one-sided, on the side where
/// 1 / depth of the pixel and the next two is closest to a line.

#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"

namespace segsim::renderer {

struct DepthNormalOptions {
  /// Three pixels in a row are one surface if 1 / depth of the middle one is off the mean of
  /// the others by at most this fraction.
  float max_bend = 0.01F;
  /// Where only two are known, they are one surface up to this relative step of 1 / depth.
  float max_step = 0.05F;
};

/// Rows [y_begin, y_end) of the normals; rows are independent of one another.
/// @param depth_m  Along +z of the camera; not finite or <= 0 = unknown.
/// @param normals  Of the same size. World frame, unit, towards the camera; 0 where the pixel
///     or all its neighbours along an axis are unknown or across an edge.
void depth_normal_rows(const core::Image<float>& depth_m,
                       const core::CameraIntrinsics& intrinsics,
                       const core::CameraPose& T_world_camera, int y_begin, int y_end,
                       core::Image<glm::vec3>& normals,
                       const DepthNormalOptions& options = {});

/// All rows.
[[nodiscard]] core::Image<glm::vec3> depth_normals(const core::Image<float>& depth_m,
                                                   const core::CameraIntrinsics& intrinsics,
                                                   const core::CameraPose& T_world_camera,
                                                   const DepthNormalOptions& options = {});

}  // namespace segsim::renderer
