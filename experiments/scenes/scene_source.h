#pragma once

/// @file
/// From a source (procedural flat, Gazebo world, mesh file, recording) to an RGB-D sequence.

#include <filesystem>
#include <memory>
#include <string>

#include "experiments/specs/spec.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::experiments::scenes {

/// All that decides the outcome of a capture, in one line; part of what a bundle records.
[[nodiscard]] std::string describe_capture(const specs::SourceSpec& source);

/// Walks a virtual RGB-D camera through the mesh world of `source` and writes the 7-Scenes
/// layout with exact labels into `folder`. Complete frames of an interrupted capture are kept;
/// `trajectory` (may be empty) replaces the planned path.
void capture_mesh_source(const specs::SourceSpec& source, const std::filesystem::path& folder,
                         const std::filesystem::path& trajectory = {}, bool depth_exr = false,
                         bool overwrite = false);

/// Beside the frames of a recording and in the bundle made of it: makers and licences of what
/// stands in the place, a line each.
inline constexpr const char* kCreditsFileName = "CREDITS.txt";
/// The text of that file; empty if there is none.
[[nodiscard]] std::string read_credits(const std::filesystem::path& folder);

/// Opens a recording, with labels from 3-D boxes if `boxes` is not empty.
[[nodiscard]] std::unique_ptr<reconstruction::RgbdSequence> open_recording(
    const std::filesystem::path& folder, const std::filesystem::path& boxes,
    const reconstruction::SequenceOptions& options);

}  // namespace segsim::experiments::scenes
