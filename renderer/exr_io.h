#pragma once

/// @file
/// Rendered views as multi-channel OpenEXR images.
///
///     R, G, B                half    linear light (the frame's sRGB bytes, decoded), over
///     black A                      float   accumulated opacity Z                      float
///     depth along the camera's +z [m], NaN = none N.X, N.Y, N.Z          float   unit normal
///     in the world frame, 0 = none semantic, instance     uint    ids, 0 = none confidence
///     float   share of the label's votes
///
/// Header attributes: fx_px, fy_px, cx_px, cy_px (double; the first pixel's centre is at 0.5),
/// T_world_camera (m44f; element [row][column] of the matrix that maps column vectors in the
/// camera frame to the world frame) and `frames` (string), which names both frames' axes.

#include <filesystem>

#include "core/image.h"
#include "core/render.h"

namespace segsim::renderer {

/// Writes the images that are not empty. @throws core::InputError if the file cannot be
/// written.
void write_frame_exr(const std::filesystem::path& file, const core::Frame& frame);

/// Reads what write_frame_exr() wrote; images without channels in the file are empty.
/// @throws core::InputError for a file that is not of this kind.
[[nodiscard]] core::Frame read_frame_exr(const std::filesystem::path& file);

/// Writes a single float channel Z [m].
void write_depth_exr(const std::filesystem::path& file, const core::Image<float>& depth_m);

/// Reads channel Z of any EXR image. @throws core::InputError if there is none.
[[nodiscard]] core::Image<float> read_depth_exr(const std::filesystem::path& file);

}  // namespace segsim::renderer
