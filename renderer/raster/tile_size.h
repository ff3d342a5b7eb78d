#pragma once

/// @file
/// Side of a tile; the tile lists, the pixel loop and the labels agree on it.

namespace segsim::renderer::internal {

inline constexpr int kTileSizePx = 16;

}  // namespace segsim::renderer::internal
