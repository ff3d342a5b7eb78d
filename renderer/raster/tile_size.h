#pragma once

/// @file
/// Side of a tile; the tile lists, the pixel loop and the labels agree on it.

namespace segsim::renderer::internal {

inline constexpr int kTileSizePx = 16;

/// Counts the lanes of a vector. Highway's Iota() fills memory lane by lane and waits for it.
alignas(64) inline constexpr float kCounting[kTileSizePx] = {0, 1, 2,  3,  4,  5,  6,  7,
                                                             8, 9, 10, 11, 12, 13, 14, 15};

}  // namespace segsim::renderer::internal
