#pragma once

/// @file
/// COLMAP's sparse models (Schoenberger and Frahm, CVPR 2016), text or binary. Poses are
/// world-to-camera in the files, axes x right, y down, z forward; the first pixel's centre is
/// (0.5, 0.5). The scale is arbitrary unless somebody made it metric.

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/frames.h"
#include "reconstruction/datasets/internal/lens.h"

namespace segsim::reconstruction::internal {

struct ColmapImage {
  std::string name;  ///< Path below the folder of images.
  std::uint32_t camera_id = 0;
  core::CameraPose T_world_camera;
  std::string place;                       ///< For messages: "images.txt:12".
  std::vector<std::uint32_t> seen_points;  ///< Indices of ColmapModel::points_m, ascending.
};

struct ColmapModel {
  std::map<std::uint32_t, Lens> cameras;
  std::vector<ColmapImage> images;  ///< Ascending by name.
  /// points3D of two pixels of reprojection error at most; empty if there is no such file.
  std::vector<glm::dvec3> points_m;
  std::map<std::uint32_t, std::size_t> image_of_id;  ///< Only while files are read.
};

/// True if cameras and images lie in `folder`, both .bin or both .txt.
[[nodiscard]] bool has_colmap_model(const std::filesystem::path& folder);

/// Prefers .bin. Camera models: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV,
/// OPENCV_FISHEYE.
/// @throws InputError naming file and line (or entry): a file ends early, another camera
/// model, an image of an unknown camera, a quaternion that is none, a point without a place.
[[nodiscard]] ColmapModel read_colmap_model(const std::filesystem::path& folder);

/// The camera of all `images`.
/// @throws InputError if two of them differ.
[[nodiscard]] Lens common_lens(const ColmapModel& model, const std::filesystem::path& folder);

}  // namespace segsim::reconstruction::internal
