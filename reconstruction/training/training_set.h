#pragma once

/// @file
/// The frames of a recording as training reads them: all in memory, each with its own camera
/// pose, training and held-out frames apart.

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/frame_masks.h"
#include "core/frames.h"
#include "core/image.h"
#include "reconstruction/datasets/mask_files.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction {

/// One view. Images are of the set's size.
struct TrainingView {
  std::size_t frame = 0;  ///< Index in the recording.
  std::string name;
  core::CameraPose T_world_camera;
  core::Image<core::Rgb8> rgb;
  core::Image<float> depth_m;  ///< NaN = unknown; empty if the frame has none.
  DepthSensor sensor = DepthSensor::kUnstated;  ///< What measured it, if that was stated.
  core::Image<std::uint8_t> valid;  ///< 0 = not to be learned from; empty: all count.
  core::FrameMasks masks;           ///< Empty without labels.
};

struct TrainingSetOptions {
  int held_out_every = 8;  ///< n > 1: frames with index % n == 0 are for testing; else none.
  int frame_step = 1;      ///< Use every n-th frame, for training and for testing.
  bool labels = true;      ///< Keep masks.
  int shrink = 1;          ///< n > 1: n x n pixels become one (shrunk()).
};

struct TrainingSet {
  core::CameraIntrinsics intrinsics;
  std::vector<core::SceneClass> classes;  ///< Of the masks; empty without labels.
  std::vector<TrainingView> training, held_out;
  /// Held-out views whose masks are exact labels; false if masks came from a segmenter and the
  /// recording has no labels of its own.
  bool has_true_labels = false;
  std::vector<std::string> warnings;  ///< One line for each doubt.

  /// Radius of the camera path: 1.1 times the largest distance from its centre (2DGS: "scene
  /// extent"), at least 0.5 m.
  [[nodiscard]] double extent_m() const;
};

/// The camera of shrunk() views: columns and rows that fill no block are cut off on the right
/// and below.
[[nodiscard]] core::CameraIntrinsics shrunk(const core::CameraIntrinsics& intrinsics, int n);
/// A view with one pixel for n x n: the mean colour of the block, valid if all of it is;
/// depth and labels of the pixel in its middle, since a mean over an edge is on neither side
/// of it.
[[nodiscard]] TrainingView shrunk(const TrainingView& view, int n);

/// Loads all frames that are used. A frame that repeats another, picture and pose, is left out
/// with a warning: training frames before held-out ones, which it would flatter; the same
/// picture at another pose is a warning.
/// @param masks  Labels to learn from instead of the recording's; may be null. Held-out views
///     keep the recording's, as truth.
/// @throws core::InputError for a frame or mask that cannot be read, masks whose classes are
///     not those of the recording, or no frame left to train on.
[[nodiscard]] TrainingSet load_training_set(
    const RgbdSequence& recording, const MaskSet* masks, const TrainingSetOptions& options,
    const std::function<void(std::int64_t done, std::int64_t total)>& progress = {});

/// The recording's own labels of a frame as masks of confidence 1.
[[nodiscard]] core::FrameMasks exact_masks(const RgbdFrame& frame);

}  // namespace segsim::reconstruction
