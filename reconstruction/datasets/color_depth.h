#pragma once

/// @file
/// Where the depth camera of a recording stands against its colour camera, if depth images are
/// not yet views of the colour camera. The file, as `segsim reconstruct --color-depth` takes
/// and writes it:
///
///     schema: segsim.color_depth
///     version: 1
///     T_color_depth: [r, r, r, x,  r, r, r, y,  r, r, r, z,  0, 0, 0, 1]   # row-major,
///     metres depth_camera: {width: 640, height: 480, fx: 575.8, fy: 575.8, cx: 319.5, cy:
///     239.5,
///                    pixel_center: 0}            # optional; pixel_center: 0.5 (default) or 0
///
/// T_color_depth takes coordinates of the depth camera to those of the colour camera (x right,
/// y down, z forward): a depth camera 2.5 cm to the right of the colour camera has x = 0.025.
/// Without depth_camera, depth images have the camera matrix that the layout gives them.

#include <filesystem>
#include <optional>

#include "core/camera.h"
#include "core/frames.h"

namespace segsim::reconstruction {

/// From one camera to another one, or to the same one at another time.
using CameraToCamera = core::Transform<core::frame::Camera, core::frame::Camera>;

struct ColorDepth {
  CameraToCamera T_color_depth;
  /// Of the depth images as they lie on disk; none: as the layout has it.
  std::optional<core::CameraIntrinsics> depth_camera;
};

/// @throws core::InputError naming file, line and key: no rigid transform, no camera, unknown
/// keys.
[[nodiscard]] ColorDepth read_color_depth(const std::filesystem::path& file);

/// Atomically; read_color_depth() gives the same again to 1e-9.
void write_color_depth(const std::filesystem::path& file, const ColorDepth& color_depth);

}  // namespace segsim::reconstruction
