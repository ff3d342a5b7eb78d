#pragma once

/// @file
/// Recordings whose depth is found by stereo (reconstruction/stereo) instead of being read.

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "reconstruction/datasets/rgbd_sequence.h"
#include "reconstruction/stereo/depth_comparison.h"
#include "reconstruction/stereo/stereo_depth.h"

namespace segsim::experiments::scenes {

/// Where a recording's depth comes from.
enum class DepthSource : unsigned char {
  kAuto,      ///< The recording's own, if all frames have some, else stereo.
  kRecorded,  ///< The recording's own, or none.
  kStereo,
  kNone,
};

/// "auto", "recorded", "stereo", "none". @throws InputError for another word.
[[nodiscard]] DepthSource parse_depth_source(const std::string& word,
                                             const std::string& place);

/// A recording with depth of ours, and how good it is.
struct StereoRecording {
  std::unique_ptr<reconstruction::RgbdSequence> sequence;
  reconstruction::StereoReport report;
  /// Where the recording has depth of its own.
  std::optional<reconstruction::DepthComparison> comparison;
};

/// Finds depth, with progress lines, and prints what came of it; then opens the recording
/// again with it.
/// @param recorded  As it was opened with `options`: its pictures and poses are matched, its
///     depth is only compared with.
/// @param boxes  As open_recording() takes them.
/// @param work  Folder of the depth images; what it holds already is not made again.
/// @throws core::InputError as of reconstruction::estimate_depth().
[[nodiscard]] StereoRecording open_with_stereo(const std::filesystem::path& folder,
                                               const std::filesystem::path& boxes,
                                               reconstruction::SequenceOptions options,
                                               const reconstruction::RgbdSequence& recorded,
                                               const reconstruction::StereoOptions& stereo,
                                               const std::filesystem::path& work);

}  // namespace segsim::experiments::scenes
