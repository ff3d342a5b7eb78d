#pragma once

/// @file
/// Labelled views of procedural scenes, rendered exactly, with the same box rule as everything
/// else: the plain rooms that the detector is pre-trained on, and homes that it never sees.

#include <cstdint>
#include <filesystem>

#include "core/camera.h"

namespace segsim::experiments::detection {

struct SourceDatasetOptions {
  std::uint64_t seed = 1;
  int rooms = 250;
  int views_per_room = 8;
  core::CameraIntrinsics camera = core::CameraIntrinsics::from_fov(256, 256, 1.2);
};

/// Renders views of rooms seed, seed + 1, ... (worlds/procedural/source_domain.h) into
/// `folder`/images and writes `folder`/labels.json. Skipped if that file exists and was made
/// with the same options.
/// @return  The JSON file.
std::filesystem::path render_source_dataset(const SourceDatasetOptions& options,
                                            const std::filesystem::path& folder);

struct UnseenHomesOptions {
  std::uint64_t seed = 1;
  int homes = 4;
  int views_per_home = 40;
  core::CameraIntrinsics camera;
  double camera_height_m = 1.2, camera_pitch_down_rad = 0.0;  ///< The robot's.
};

/// The same for furnished flats seed, seed + 1, ... (worlds/procedural/procedural_flat.h),
/// from places all over their free floor.
std::filesystem::path render_unseen_homes(const UnseenHomesOptions& options,
                                          const std::filesystem::path& folder);

}  // namespace segsim::experiments::detection
