#pragma once

/// @file
/// Writes what a renderer sees as an RGB-D sequence in the 7-Scenes layout with exact labels:
///
///     frame-000000.color.png     8-bit sRGB
///     frame-000000.depth.png     uint16, millimetres along +z, 0 = no measurement
///     frame-000000.depth.exr     float32 channel "Z", metres, NaN = none (optional)
///     frame-000000.semantic.png  uint16 class id, 0 = void
///     frame-000000.instance.png  uint16 instance id, 0 = none
///     frame-000000.pose.txt      4 x 4 camera-to-world, row-major; x right, y down, z forward
///     intrinsics.txt             3 x 3; pixel centres at +0.5, as labels.yaml says
///     labels.yaml                names of the ids
///     capture.txt                settings, by which a second call knows what it may keep

#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/frames.h"
#include "core/render.h"
#include "core/scene_bundle.h"

namespace segsim::worlds {

struct CaptureOptions {
  bool depth_exr = false;
  double max_depth_m = 20.0;  ///< Farther is "no measurement"; at most 65.535.
  /// Throws away what lies there; otherwise complete frames of equal settings are kept, and a
  /// folder with other settings is refused.
  bool overwrite = false;
  std::string source;  ///< In words, into labels.yaml; part of the settings.
  /// Called after each frame with (frames done, frames in all).
  std::function<void(int, int)> on_frame;
};

struct CaptureReport {
  int written = 0, kept = 0;
  double render_s = 0.0, write_s = 0.0;
};

/// Renders and writes one frame per pose. Each file appears whole or not at all, and the pose
/// is written last, so a frame with a pose file is complete: an interrupted capture can be
/// resumed.
/// @throws InputError if the folder cannot be written or belongs to another capture.
CaptureReport capture_sequence(core::Renderer& renderer,
                               std::span<const core::CameraPose> poses,
                               const core::CameraIntrinsics& intrinsics,
                               const std::filesystem::path& folder,
                               const std::vector<core::SceneClass>& classes,
                               const std::vector<core::SceneInstance>& instances,
                               const CaptureOptions& options = {});

}  // namespace segsim::worlds
