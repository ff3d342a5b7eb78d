#pragma once

/// @file
/// Point clouds of laser scanners and other programs: PCD (read by PCL) and PLY, ASCII and
/// binary.

#include <filesystem>
#include <vector>

#include <glm/vec3.hpp>

#include "core/image.h"

namespace segsim::reconstruction {

struct PointCloud {
  std::vector<glm::vec3> position_m;  ///< In the file's own coordinates; finite.
  std::vector<core::Rgb8> rgb;        ///< sRGB; empty if the file has no colours.
};

/// Reads x, y, z and, if there are any, colours (PCD: rgb or rgba; PLY: red, green, blue).
/// Points that are not finite are left out: scanners write them where no echo came back.
/// @throws core::InputError for a file that is missing, of another kind, damaged, without
///     coordinates, or without a single finite point.
[[nodiscard]] PointCloud read_point_cloud(const std::filesystem::path& file);

}  // namespace segsim::reconstruction
