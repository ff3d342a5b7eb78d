#pragma once

/// @file
/// What all file-based layouts share: a loader lists the frames, `finish_sequence` checks the
/// files, brings the poses to the world frame and makes the sequence.

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "renderer/datasets/internal/image_files.h"
#include "renderer/datasets/rgbd_sequence.h"

namespace segsim::renderer::internal {

/// Files of one frame; empty path = there is none.
struct FrameFiles {
  std::string name;
  std::filesystem::path rgb, depth_png, depth_exr, semantic, instance;
  core::CameraPose T_world_camera;  ///< In the source's world until finish_sequence.
};

struct SequenceParts {
  std::string name;
  core::CameraIntrinsics intrinsics;
  std::vector<FrameFiles> frames;
  bool has_masks = false;
  std::vector<core::SceneClass> classes;
  std::vector<core::SceneInstance> instances;
  std::vector<std::string> warnings, notes;
};

/// How to bring the source's world to ours.
struct WorldConvention {
  UpAxis up = UpAxis::kZ;                ///< kY or kZ.
  bool fit_floor = true;                 ///< Without floor_height_m: fit it; else it is 0.
  std::optional<double> floor_height_m;  ///< Along `up`, in the source's world.
};

/// Runs `check`; an InputError becomes a warning with the frame's name under
/// OnBadFrame::kSkip.
/// @return false if the frame is to be left out.
[[nodiscard]] bool accept_frame(OnBadFrame on_bad_frame, const std::string& frame_name,
                                std::vector<std::string>& warnings,
                                const std::function<void()>& check);

/// Size of the first colour image that is intact.
/// @throws InputError if none is.
[[nodiscard]] ImageSize first_image_size(const std::vector<FrameFiles>& frames,
                                         const std::filesystem::path& folder);

[[nodiscard]] std::unique_ptr<RgbdSequence> finish_sequence(
    SequenceParts parts, const std::filesystem::path& folder,
    const WorldConvention& convention, OnBadFrame on_bad_frame);

// The loaders, one file each.
[[nodiscard]] bool looks_like_hololens(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<RgbdSequence> open_hololens(const std::filesystem::path& folder,
                                                          const SequenceOptions& options);
[[nodiscard]] bool looks_like_seven_scenes(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<RgbdSequence> open_seven_scenes(
    const std::filesystem::path& folder, const SequenceOptions& options);

}  // namespace segsim::renderer::internal
