#pragma once

/// @file
/// Are the poses what they are taken for: camera-to-world, in metres, with depth in metres?
/// Depth of one frame, brought to another frame, must be what was measured there. Every
/// hypothesis (poses inverted or not; lengths of the poses times some factor) is tried, and
/// the one under which most depth agrees tells what the recording really holds.
///
/// Depth and poses agree also if both are wrong by the same factor, so how far away things are
/// is looked at, too.

#include <optional>
#include <vector>

#include "reconstruction/inspection/finding.h"
#include "reconstruction/inspection/recording_sample.h"

namespace segsim::reconstruction {

struct PoseHypothesis {
  bool inverted = false;
  double scale = 1.0;      ///< Of the poses against depth.
  double agreement = 0.0;  ///< Share of depth that is the same in both views, 0 to 1.
};

struct PoseEvidence {
  PoseHypothesis given;  ///< As the recording was opened.
  PoseHypothesis best;
  /// As `given`, of what lies in both views: high for good poses, however little that is.
  double given_of_landed = 0.0;
  std::size_t pairs = 0;  ///< Of frames whose agreement depends on the hypothesis.
};

/// @param T_world_source  RgbdSequence::T_world_source(): poses are inverted in the source's
/// world.
/// @return nullopt if too few frames see the same thing from two places.
[[nodiscard]] std::optional<PoseEvidence> weigh_poses(
    const RecordingSample& sample,
    const core::Transform<core::frame::World, core::frame::World>& T_world_source);

/// Inverted poses, wrong units, and poses that fit depth under no hypothesis.
[[nodiscard]] std::vector<Finding> find_wrong_poses(const RgbdSequence& sequence,
                                                    const RecordingSample& sample);

}  // namespace segsim::reconstruction
