#pragma once

/// @file
/// Depth for recordings that have none, by multi-view stereo with the recording's poses.
///
///     pictures, grey and small
///       -> coarse sweep of every view: where its surfaces are    (plane_sweep, semi_global)
///       -> sources of every view by angle and overlap            (source_views)
///       -> plane sweep, semi-global matching, slanted windows    (slanted_refinement)
///       -> depth that at least two further views agree on        (view_consistency)
///       -> FOLDER/NNNNNN.exr, which SequenceOptions::own_depth reads
///
/// Where pictures show nothing to match, and where nothing was seen from two places, holes
/// stay holes. Equal input gives equal output, whatever the number of threads.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction {

struct StereoOptions {
  int width_px = 320;    ///< Of the pictures that are matched, and of the depth images.
  int sources = 4;       ///< Views that each is matched with, at most.
  int fewest_views = 2;  ///< Further views that must agree about a depth.
  /// Nearest and farthest depth along +z [m]. None: of the recording's sparse points, else
  /// 0.3 m, and 4 m more than the cameras' places are apart (at least 6 m).
  std::optional<std::pair<double, double>> depth_range_m;
  int frame_step = 1;      ///< Use every n-th frame.
  int held_out_every = 0;  ///< n > 1: frames with index % n == 0 are not looked at.
  int threads = 0;         ///< 0 = all.
};

struct StereoReport {
  std::size_t frames = 0;            ///< Looked at.
  std::size_t frames_matched = 0;    ///< With at least two sources.
  std::size_t frames_resumed = 0;    ///< Of these: found in the folder.
  double known_share = 0.0;          ///< Of the pixels of all frames: with depth.
  double near_m = 0.0, far_m = 0.0;  ///< Where depth was looked for.
  double seconds = 0.0;
};

/// @param stage  Words for a progress line.  @param done, total  Frames of that stage.
using StereoProgress =
    std::function<void(const std::string& stage, std::int64_t done, std::int64_t total)>;

/// Writes the depth of every frame that is used as SequenceOptions::own_depth wants it: files
/// own_depth_name(i), float EXR, channel Z, metres along +z, NaN
/// where there is none, of the recording's view at options.width_px. Each file is whole or not
/// there. What each view found by itself is kept in the folder, too: a run that was stopped
/// goes on, and one with other pictures, poses or options begins anew.
/// @param folder  Made if it is not there; its depth images are replaced.
/// @throws core::InputError if a frame cannot be read; if fewer than a quarter of the frames
/// show the same surfaces as two others from places far enough apart; if views agree on less
/// than 2 % of the pixels (wrong poses).
StereoReport estimate_depth(const RgbdSequence& sequence, const StereoOptions& options,
                            const std::filesystem::path& folder,
                            const StereoProgress& progress = {});

}  // namespace segsim::reconstruction
