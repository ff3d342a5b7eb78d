#pragma once

/// @file
/// Camera and pose as attributes of an OpenEXR header.
///
///     fx_px, fy_px, cx_px, cy_px   double   pixel (0, 0) has its centre at (0.5, 0.5)
///     T_world_camera               m44f     element [row][column], for column vectors
///     frames                       string   axes of both frames, in words
///
/// Standard attributes, in OpenEXR's own conventions (matrices act on row vectors):
///
///     worldToCamera        to its left-handed camera: x right, y up, z forward
///     worldToNDC           (x/w, y/w); (0, 0) is upper left, (1, 1) lower right
///     screenWindowWidth    width of the image at distance 1
///     screenWindowCenter   its centre there, x right, y up
///     pixelAspectRatio     width over height of a pixel

#include "core/camera.h"
#include "core/frames.h"
#include "renderer/files/internal/exr_file.h"

namespace segsim::renderer::internal {

/// The standard attribute that must be equal in all parts: fy / fx.
[[nodiscard]] float exr_pixel_aspect_ratio(const core::CameraIntrinsics& intrinsics);

void set_exr_camera(const core::CameraIntrinsics& intrinsics,
                    const core::CameraPose& T_world_camera, Imf::Header& header);

/// @throws core::InputError for a missing attribute or a value that no camera has.
[[nodiscard]] core::CameraIntrinsics exr_intrinsics(const ExrInput& input);
[[nodiscard]] core::CameraPose exr_pose(const ExrInput& input);

}  // namespace segsim::renderer::internal
