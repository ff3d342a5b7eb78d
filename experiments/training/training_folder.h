#pragma once

/// @file
/// What a training leaves for people to look at before its bundle is complete:
///
///     <work>/surfels.ply   surfels at the last checkpoint (renderer/files/ply_io.h)
///     <work>/cameras.txt   where the training frames were taken, as far as refined
///     <work>/losses.csv    stage, iteration, seconds, surfels, loss, value

#include <filesystem>
#include <string>
#include <vector>

#include "core/camera_path.h"
#include "core/frames.h"
#include "reconstruction/training/training_set.h"
#include "renderer/scene/surfels.h"

namespace segsim::experiments::training {

inline constexpr const char* kSurfelsSoFar = "surfels.ply";
inline constexpr const char* kCamerasSoFar = "cameras.txt";
inline constexpr const char* kLosses = "losses.csv";

/// Replaces surfels and cameras, each file at once.
/// @param poses  T_world_camera of the training frames; empty: as recorded.
void write_so_far(const std::filesystem::path& work, const renderer::SurfelCloud& surfels,
                  const reconstruction::TrainingSet& set,
                  const std::vector<core::CameraPose>& poses);

/// A folder with surfels and losses, and no bundle.
[[nodiscard]] bool is_training_folder(const std::filesystem::path& folder);

/// "geometry, iteration 1200, 61 s": the last line of losses.csv in words; "not begun" without
/// any.
[[nodiscard]] std::string training_progress(const std::filesystem::path& work);

/// Of a folder of which is_training_folder() is true.
/// @throws core::InputError naming file and line.
[[nodiscard]] core::CameraPath cameras_so_far(const std::filesystem::path& work);

}  // namespace segsim::experiments::training
