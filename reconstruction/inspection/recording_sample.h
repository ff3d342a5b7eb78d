#pragma once

/// @file
/// What the checks look at: the whole path, and of some frames what is small enough to be
/// kept. However long the recording, so many frames are read, and one image per thread is in
/// memory.

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "core/frames.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "reconstruction/inspection/depth_thumbnail.h"
#include "reconstruction/inspection/edge_view.h"
#include "reconstruction/inspection/image_detail.h"
#include "reconstruction/inspection/rig_fit.h"

namespace segsim::reconstruction {

struct SampleOptions {
  std::size_t most_frames = 800;  ///< Spread evenly over the recording.
  std::size_t anchors = 48;       ///< Of these many frames partners are read, too.
  std::size_t edge_views = 40;    ///< Of these many frames edges are kept.
};

struct FrameSample {
  std::size_t frame = 0;  ///< Index in the sequence.
  ImageDetail detail;
  double hole_share = 1.0;      ///< Pixels without depth.
  double median_depth_m = 0.0;  ///< 0 without any.
  DepthThumbnail depth;
  std::optional<EdgeView> edges;
  std::optional<RigView> rig;  ///< Of the same frames as `edges`.
};

struct RecordingSample {
  std::vector<core::CameraPose> path;  ///< T_world_camera of all frames.
  std::vector<FrameSample> frames;     ///< Ascending.
  /// Places in `frames` of two views of the same thing from nearby, first the earlier one.
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  double median_depth_m = 0.0;  ///< Of the sampled frames; 0 without depth.
};

/// @throws InputError if a frame cannot be read.
[[nodiscard]] RecordingSample sample_recording(const RgbdSequence& sequence,
                                               const SampleOptions& options = {});

}  // namespace segsim::reconstruction
