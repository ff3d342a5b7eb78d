#pragma once

/// @file
/// Where the cameras of a recording were, as text (`cameras.txt` of a scene bundle):
///
///     segsim cameras 1
///
///     intrinsics WIDTH_px HEIGHT_px FX_px FY_px CX_px CY_px
///
///     X_m Y_m Z_m QX QY QZ QW FRAME      (T_world_camera, a line for every view)

#include <filesystem>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/frames.h"

namespace segsim::core {

struct CameraPath {
  struct View {
    CameraPose T_world_camera;
    std::string frame;  ///< Name in the recording; one line.
  };
  CameraIntrinsics intrinsics;
  std::vector<View> views;

  [[nodiscard]] std::vector<CameraPose> poses() const;
};

void write_camera_path(const std::filesystem::path& file, const CameraPath& path);
/// @throws InputError naming file and line: another kind of file, numbers that are missing or
///     not finite, a rotation that is none, intrinsics of no camera.
[[nodiscard]] CameraPath read_camera_path(const std::filesystem::path& file);

}  // namespace segsim::core
