#pragma once

/// @file
/// Blends the surfels of one tile and writes its pixels.

#include <cstdint>

#include "core/render.h"
#include "renderer/internal/projection.h"
#include "renderer/internal/tile_binning.h"
#include "renderer/render_options.h"

namespace segsim::renderer::internal {

struct RasterJob {
  const ProjectedSurfels& projected;
  const TileBins& bins;
  core::Frame& frame;  ///< Images of the wanted channels have their size.
  core::Channels channels;
  int top_k;
  bool median_depth;  ///< Else the expected depth.
  bool labelled;      ///< False: the scene has no labels, all pixels are void.
};

struct TileStats {
  std::uint64_t pairs_touched = 0, evaluations = 0, contributions = 0;
};

[[nodiscard]] TileStats raster_tile(const RasterJob& job, std::size_t tile);

}  // namespace segsim::renderer::internal
