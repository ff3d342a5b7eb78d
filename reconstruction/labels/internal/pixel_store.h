#pragma once

/// @file
/// A few pixels of every frame, with their rows of W: what a head renders when it is finished,
/// to cluster features or to name clusters. Geometry is frozen, so rows that were seen once
/// stay right.

#include <set>
#include <string>
#include <vector>

#include "reconstruction/internal/tensors/state_file.h"
#include "reconstruction/labels/internal/batch_targets.h"
#include "reconstruction/labels/internal/sparse_blend.h"

namespace segsim::reconstruction::internal {

class PixelStore {
 public:
  /// @param pixels  Of all frames together.
  PixelStore(std::int64_t frames, std::int64_t pixels, std::uint64_t seed,
             const at::Device& device);

  /// Keeps a random subset of these pixels of a batch, unless the frame has some already.
  /// @param matrix  Of the batch.  @param candidates  Its rows.
  void keep(const PanopticBatch& batch, const BlendMatrix& matrix, const BatchTargets& targets,
            const std::vector<std::int64_t>& candidates);

  [[nodiscard]] std::int64_t size() const {
    return static_cast<std::int64_t>(class_index_.size());
  }
  // Of every kept pixel.
  [[nodiscard]] const std::vector<std::int64_t>& frame() const { return frame_; }
  [[nodiscard]] const std::vector<std::int64_t>& class_index() const { return class_index_; }
  /// Id of its mask in its frame, 0 = none.
  [[nodiscard]] const std::vector<std::int64_t>& mask_id() const { return mask_id_; }

  /// @param values  [surfels of the cloud, channels].  @return  [size(), channels].
  [[nodiscard]] Tensor blend(const Tensor& values) const;

  void save(StateWriter& out) const;
  void load(const StateReader& in);

 private:
  std::int64_t per_frame_;
  std::uint64_t seed_;
  std::vector<std::int64_t> frame_, class_index_, mask_id_;
  std::set<std::int64_t> has_;    ///< Frames with pixels.
  Tensor surfel_, row_, weight_;  ///< [entries]: of the cloud, in the store, normalised.
};

}  // namespace segsim::reconstruction::internal
