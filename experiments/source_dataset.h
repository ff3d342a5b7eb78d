#pragma once

/// @file
/// The data that the detector is pre-trained on: plain procedural rooms, rendered exactly,
/// with the same box rule as everything else.

#include <cstdint>
#include <filesystem>

#include "core/camera.h"

namespace segsim::experiments {

struct SourceDatasetOptions {
  std::uint64_t seed = 1;
  int rooms = 250;
  int views_per_room = 8;
  core::CameraIntrinsics camera = core::CameraIntrinsics::from_fov(256, 256, 1.2);
};

/// Renders views of rooms seed, seed + 1, ... (sim/source_domain.h) into `folder`/images and
/// writes `folder`/labels.json. Skipped if that file exists and was made with the same
/// options.
/// @return  The JSON file.
std::filesystem::path render_source_dataset(const SourceDatasetOptions& options,
                                            const std::filesystem::path& folder);

}  // namespace segsim::experiments
