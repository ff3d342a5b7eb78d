#pragma once

/// @file
/// Boxes of tiles under the strategies of TileBounds.

#include "renderer/raster/projection.h"

namespace segsim::renderer::internal {

/// Tiles [x_begin, x_end) x [y_begin, y_end).
struct TileRange {
  int x_begin, x_end, y_begin, y_end;
};

/// Of the surfel's pixel range.
[[nodiscard]] TileRange exact_range(const ScreenSurfel& s);

/// kAabb: tiles_of_square() of aabb_3_sigma(), as the 2DGS code lists them. kPaper: the box of
/// paper_outline(), united with the low pass.
/// @param i  Packed surfel.
/// @param outline  Replaced by the paper's for kPaper.
[[nodiscard]] TileRange approximate_range(const ProjectionJob& job, std::size_t i,
                                          ScreenEllipse<float>& outline);

}  // namespace segsim::renderer::internal
