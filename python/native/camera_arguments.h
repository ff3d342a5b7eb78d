#pragma once

/// @file
/// Cameras as Python gives them: arrays of poses and camera matrices. What is wrong with one
/// is said with the name of the argument and the number of the view.

#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>

#include "core/camera.h"
#include "core/frames.h"

namespace segsim::python {

inline constexpr int kLongestSide_px = 65535;  ///< renderer/cpu_renderer.h

/// Views to draw, in one call.
struct Views {
  std::vector<core::CameraPose> T_world_camera;
  std::vector<core::CameraIntrinsics> intrinsics;  ///< One for all, or one for each pose.
  bool batch = false;  ///< The poses came as [N, 4, 4], so images get an axis of views.

  [[nodiscard]] const core::CameraIntrinsics& intrinsics_of(std::size_t view) const {
    return intrinsics[intrinsics.size() == 1 ? 0 : view];
  }
};

/// @param T_world_camera  [4, 4] or [N, 4, 4], anything that NumPy makes an array of.
/// @param K  [3, 3] or, with N poses, [N, 3, 3].
/// @param size_px  Width and height.
/// @throws core::InputError naming the argument: another shape, no rotation, a last row that
/// is
///     not (0, 0, 0, 1), skew, a focal length that is not positive, numbers that are not
///     finite.
[[nodiscard]] Views views_of(nanobind::handle T_world_camera, nanobind::handle K,
                             std::pair<int, int> size_px);

/// [4, 4], float64.
[[nodiscard]] nanobind::object pose_matrix(const core::CameraPose& T_world_camera);
/// [N, 4, 4], float64.
[[nodiscard]] nanobind::object pose_matrices(std::span<const core::CameraPose> T_world_camera);
/// [3, 3], float64.
[[nodiscard]] nanobind::object camera_matrix(const core::CameraIntrinsics& intrinsics);

/// "[2, 64, 96, 3]", for messages.
[[nodiscard]] std::string shape_text(const std::vector<std::size_t>& shape);

}  // namespace segsim::python
