#pragma once

/// @file
/// RGB-D frames -> surfels without optimisation: depth pixels of all frames are fused in a
/// hash of voxels (weighted means, class and instance votes), floaters are carved by the free
/// space that other frames saw, and every remaining voxel becomes one surfel oriented along
/// the fused neighbourhood (PCL). The result is the start of training and good enough to look
/// at by itself.

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <glm/vec3.hpp>

#include "core/scene_bundle.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction {

struct LiftOptions {
  double voxel_m = 0.02;     ///< Edge of a voxel = spacing of the surfels.
  double min_depth_m = 0.2;  ///< Pixels outside [min, max] are not used.
  double max_depth_m = 6.0;
  double max_grazing_deg = 80.0;  ///< Largest angle between surface normal and line of sight.
  int min_observations = 5;       ///< Depth pixels that a voxel needs.
  int carve_frames = 60;  ///< Frames, evenly spread, that test for free space; 0 = no carving.
  int neighbors = 16;     ///< For normals, axes and spacing.
  double opacity = 0.95;
  bool fill_holes = true;  ///< Grow floor- and wall-like planes over small holes.
  int frame_step = 1;      ///< Use every n-th frame.
  int held_out_every = 0;  ///< n > 1: frames with index % n == 0 are left for testing.
  int threads = 0;         ///< 0 = all.
};

struct LiftStatistics {
  std::size_t frames_used = 0, frames_held_out = 0;
  std::uint64_t pixels_valid = 0;    ///< With a depth in range.
  std::uint64_t pixels_dropped = 0;  ///< Of these: at depth edges or grazing.
  std::size_t voxels = 0;            ///< Occupied after fusion.
  std::size_t voxels_sparse = 0;     ///< Dropped: too few observations.
  std::size_t voxels_carved = 0;     ///< Dropped: seen through.
  std::size_t voxels_outlier = 0;    ///< Dropped: far from their neighbours.
  std::size_t voxels_filled = 0;     ///< Added by plane growth.
  double label_agreement = 0.0;  ///< Mean share of a labelled voxel's votes for its winner.
  double seconds = 0.0;

  /// Name, value pairs for SceneManifest::statistics.
  [[nodiscard]] std::vector<std::pair<std::string, double>> listing() const;
};

struct LiftResult {
  renderer::SurfelCloud
      surfels;  ///< SH degree 0; labels if the sequence has masks. Sorted by voxel.
  std::vector<core::SceneClass> classes;
  /// Those with at least one surfel; boxes are the 1 % ... 99 % quantiles of their surfels.
  std::vector<core::SceneInstance> instances;
  std::vector<glm::dvec3> camera_positions_m;  ///< Of the frames used, world frame.
  LiftStatistics statistics;
};

/// @param stage  Words for a progress line.  @param done, total  Units of that stage.
using LiftProgress =
    std::function<void(const std::string& stage, std::int64_t done, std::int64_t total)>;

/// The instances that have a surfel, with their boxes (LiftResult::instances).
/// @param surfels  Labelled.  @param known  Their boxes are ignored.
[[nodiscard]] std::vector<core::SceneInstance> instance_boxes(
    const renderer::SurfelCloud& surfels, const std::vector<core::SceneInstance>& known);

/// Indices of a recording's frames, ascending; frames between the steps are in neither list.
struct FrameSplit {
  std::vector<std::size_t> used, held_out;
};

/// @param held_out_every  n > 1: frames with index % n == 0 are left for testing.
/// @param frame_step  Of the others, those with index % frame_step == 0 are used.
[[nodiscard]] FrameSplit split_frames(std::size_t frame_count, int frame_step,
                                      int held_out_every);

/// Fuses a sequence. Equal input gives equal output, whatever the number of threads.
/// @throws InputError if a frame cannot be read or no surfel is left.
[[nodiscard]] LiftResult lift(const RgbdSequence& sequence, const LiftOptions& options = {},
                              const LiftProgress& progress = {});

}  // namespace segsim::reconstruction
