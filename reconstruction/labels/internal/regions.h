#pragma once

/// @file
/// What a segmenter of everything would have marked: the masks of things, and the region of
/// each stuff class, at the labelled pixels of a batch.

#include "reconstruction/labels/internal/head_support.h"

namespace segsim::reconstruction::internal {

struct Regions {
  std::vector<std::vector<std::int64_t>> pixels;  ///< [count], rows of the batch, ascending.
  /// [count]: the id of the mask in its frame, or -1 - class index for stuff.
  std::vector<std::int64_t> key;
  Tensor pixel;   ///< [n] int64: all of them, region after region.
  Tensor region;  ///< [n] int64, in [0, count()).
  Tensor size;    ///< [count, 1] float, pixels.

  [[nodiscard]] std::int64_t count() const { return static_cast<std::int64_t>(key.size()); }
  /// [count, channels], of [n, channels].
  [[nodiscard]] Tensor means(const Tensor& values) const;
};

/// @param min_pixels  Regions with fewer are left out.
[[nodiscard]] Regions regions_of(const BatchTargets& targets,
                                 const std::vector<core::SceneClass>& classes, int min_pixels,
                                 const at::Device& device);

}  // namespace segsim::reconstruction::internal
