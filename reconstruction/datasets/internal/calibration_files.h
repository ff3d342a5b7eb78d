#pragma once

/// @file
/// Plain-text matrices: camera matrices and camera-to-world poses.

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/frames.h"
#include "reconstruction/datasets/internal/image_files.h"

namespace segsim::reconstruction::internal {

struct NumberLine {
  int line = 0;  ///< From 1.
  std::vector<double> numbers;
};

/// Numbers separated by blanks or commas, one entry per line that is not blank. "nan" and
/// "inf" are read as such.
/// @throws InputError naming the line with a word that is not a number.
[[nodiscard]] std::vector<NumberLine> read_number_lines(const std::filesystem::path& file);

/// 9 numbers (3x3), 16 (4x4) or 4 (fx fy cx cy), row-major.
/// @param center_offset_px  Added to cx and cy: 0.5 if the file means integer pixel centres.
/// @throws InputError for another count, skew, a focal length <= 0, a principal point outside.
[[nodiscard]] core::CameraIntrinsics read_intrinsics(const std::filesystem::path& file,
                                                     const ImageSize& size,
                                                     double center_offset_px);

/// Row-major 4x4 camera-to-world. The rotation is replaced by the nearest orthonormal one.
/// @param place  For messages: "poses.txt:12".
/// @throws InputError for another count, a number that is not finite, a last row other than 0
/// 0 0 1,
///         a rotation off by more than 1e-2 or left-handed.
[[nodiscard]] core::CameraPose pose_from_matrix(std::span<const double> numbers,
                                                const std::string& place);

/// Camera-to-world from a quaternion, which is normalised.
/// @throws InputError for a length off by more than 1e-2, or a position that is not finite.
[[nodiscard]] core::CameraPose pose_from_quaternion(const glm::dquat& R_world_camera,
                                                    const glm::dvec3& p_world_camera_m,
                                                    const std::string& place);

}  // namespace segsim::reconstruction::internal
