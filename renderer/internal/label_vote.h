#pragma once

/// @file
/// From the heaviest surfels of a pixel to its label.

#include <cstdint>

namespace segsim::renderer::internal {

/// A surfel's share alpha * T in a pixel, and its label semantic | instance << 16.
struct WeightedLabel {
  float weight;
  std::uint32_t label;
};

struct PixelLabel {
  std::uint16_t semantic = 0, instance = 0;
  float confidence = 0.0F;  ///< Share of the weight that voted for `semantic`.
};

/// Class and instance with the largest summed weight; ties go to the lower id.
/// @param candidates  `count` surfels with weights > 0.
[[nodiscard]] PixelLabel vote(const WeightedLabel* candidates, int count);

}  // namespace segsim::renderer::internal
