#pragma once

/// @file
/// What a batch says, as indices: classes of the table, and the masks of this frame in order
/// of their ids.

#include <cstdint>
#include <vector>

#include "reconstruction/internal/tensors/tensors.h"
#include "reconstruction/labels/panoptic_head.h"

namespace segsim::reconstruction::internal {

/// One instance mask of the frame, of a thing class.
struct TargetMask {
  std::uint16_t id = 0;
  int class_index = 0;  ///< In the class table: of most of its sampled pixels.
  std::int64_t pixels = 0;
};

/// Host arrays of [pixels]. Void pixels, and those that the surfels hardly cover, have class
/// -1; the latter are also not valid.
struct BatchTargets {
  std::vector<std::int64_t> class_index;
  std::vector<std::int64_t> mask_index;  ///< In `masks`, or -1.
  std::vector<float> importance;         ///< Of the sample.
  std::vector<float> weight;             ///< Confidence of the mask times importance.
  std::vector<std::int64_t> labelled;    ///< Pixels with a class, ascending.
  std::vector<std::int64_t> valid;       ///< Pixels that are covered, ascending.
  std::vector<TargetMask> masks;         ///< Ascending by id.
};

/// @param alpha  [pixels], on the host.
/// @param min_mask_pixels  Masks with fewer samples are left out; their pixels keep their
/// class.
/// @throws core::InputError for a class that is not in the table.
[[nodiscard]] BatchTargets make_targets(const PanopticBatch& batch, const float* alpha,
                                        const std::vector<core::SceneClass>& classes,
                                        const PanopticTrainingConfig& config);

}  // namespace segsim::reconstruction::internal
