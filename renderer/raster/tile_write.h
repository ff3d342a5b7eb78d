#pragma once

/// @file
/// From the finished planes of a tile to the images of the frame.

#include <cstdint>
#include <span>

#include "renderer/raster/tile_state.h"

namespace segsim::renderer::internal {

/// Writes the tile's pixels to the images of the job's channels. Labels and features come from
/// job.resolve, which they need. Planes are rows of pixels; `depth` is what is wanted.
/// @param window  List position at which the present window of keys starts.
/// @return  RenderStats::feature_fetches of the tile: a label for every selected surfel of a
///     pixel, or what its rows say first; rows of features, and of scores where the surfels of
///     a pixel disagree, once for every block of such pixels.
std::uint64_t write_tile(const RasterJob& job, std::size_t tile,
                         std::span<const std::uint32_t> list, std::uint32_t window,
                         TileState& state);

}  // namespace segsim::renderer::internal
