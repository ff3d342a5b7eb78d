#pragma once

/// @file
/// The folder that stereo writes to:
///
///     recipe.txt          what all of it was made from
///     NNNNNN.exr          depth of frame NNNNNN [m], channel Z
///     inverse-NNNNNN.exr  inverse depth [1/m] that its view found by itself, channel Z

#include <filesystem>
#include <optional>
#include <string>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"

namespace segsim::reconstruction::internal {

/// Lower-case hexadecimal SHA-256 of the pixels.
[[nodiscard]] std::string digest_of(const core::Image<std::uint16_t>& grey);

class DepthFolder {
 public:
  explicit DepthFolder(std::filesystem::path folder) : folder_(std::move(folder)) {}

  /// Makes the folder. Removes images that were made by another recipe.
  void begin(const std::string& recipe) const;

  /// Nothing if it is not there or cannot be read.
  [[nodiscard]] std::optional<core::Image<float>> read_matched(std::size_t frame) const;
  void write_matched(std::size_t frame, const core::Image<float>& inverse_m,
                     const core::CameraIntrinsics& camera,
                     const core::CameraPose& T_world_camera) const;
  void write_depth(std::size_t frame, const core::Image<float>& depth_m,
                   const core::CameraIntrinsics& camera,
                   const core::CameraPose& T_world_camera) const;

 private:
  std::filesystem::path folder_;
};

}  // namespace segsim::reconstruction::internal
