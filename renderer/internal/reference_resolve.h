#pragma once

/// @file
/// Labels and features of a pixel from the surfels that it met, densely and in double
/// precision: the oracle of the fast renderer's deferred resolve.

#include <cstddef>
#include <vector>

#include "core/render.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer::internal {

/// A surfel's share alpha * T of a pixel.
struct ReferenceWeight {
  double weight;
  std::size_t surfel;
};

/// The surfels that count for labels: all, the first K, or the K heaviest (ties: the nearer).
/// @param met  In the order in which they were blended.
[[nodiscard]] std::vector<ReferenceWeight> select_top_k(std::vector<ReferenceWeight> met,
                                                        const RenderOptions& options);

/// Class and instance with the most weight, ties to the lower id, and their shares.
void write_reference_labels(const SurfelCloud& cloud,
                            const std::vector<ReferenceWeight>& selected, int x, int y,
                            core::Frame& frame);

/// Weighted means of both features, weights renormalised to 1.
void write_reference_features(const SurfelCloud& cloud,
                              const std::vector<ReferenceWeight>& selected, int x, int y,
                              core::Frame& frame);

}  // namespace segsim::renderer::internal
