#pragma once

/// @file
/// Keys of selections one by one, as an oracle for those that a tile makes in vectors.

#include <bit>
#include <cstdint>

#include "renderer/raster/selection_key.h"

namespace segsim::renderer::internal {

/// @param weight    In (2^-31, 1), or 0: no key.
/// @param position  In the window.
[[nodiscard]] constexpr std::uint32_t make_key(float weight, std::uint32_t position) {
  const auto bits = std::bit_cast<std::uint32_t>(weight);
  return (bits << kKeyShift & kKeyWeightMask) | (position ^ kKeyPositionMask);
}

}  // namespace segsim::renderer::internal
