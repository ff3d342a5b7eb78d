#pragma once

/// @file
/// Blends the surfels of one tile and writes its pixels.

#include <cstdint>
#include <memory>

#include "core/render.h"
#include "renderer/raster/projection.h"
#include "renderer/raster/tile_binning.h"
#include "renderer/scene/render_options.h"

namespace segsim::renderer::internal {

struct ResolveJob;

struct RasterJob {
  const ProjectedSurfels& projected;
  const TileBins& bins;
  core::Frame& frame;  ///< Images of the wanted channels have their size.
  core::Channels channels;
  int top_k;
  bool median_depth;  ///< Else the expected depth.
  bool labelled;      ///< False: the scene has no labels, all pixels are void.
  const ResolveJob* resolve = nullptr;  ///< Must be set.
  bool selects = false;                 ///< The Top-K surfels of a pixel are wanted.
  bool wants_depth = true;
  bool first_hits = false;   ///< TopKRule::kFirst.
  bool all_surfels = false;  ///< top_k == kAllSurfels: of those, what labels and features
  bool logs_labels = false;  ///< need.
  bool sums_features = false;
  /// Nothing but labels is wanted: a pixel is finished once its Top-K cannot change.
  bool labels_only = false;
  float stop_transmittance = kStopTransmittance;
};

struct TileStats {
  std::uint64_t pairs_touched = 0, evaluations = 0, contributions = 0, feature_fetches = 0;
  bool finished = false;
};

struct TileState;

/// A tile between two slabs.
struct TileProgress {
  std::uint32_t done = 0;    ///< Entries of the list that were blended.
  std::uint32_t window = 0;  ///< List position at which the present window of keys starts.
  std::uint32_t live_cells = 0;
  bool started = false;
  std::unique_ptr<TileState> state;  ///< Pixels; kept for later frames.

  TileProgress();
  ~TileProgress();
  TileProgress(TileProgress&&) noexcept;
};

/// Blends the entries of the tile's list that are new since the last call. Writes the pixels
/// once they are finished, or if there will be no more surfels.
/// @param last  No more surfels will come.
/// @return  Work done; `finished` if the pixels were written.
[[nodiscard]] TileStats raster_tile(const RasterJob& job, std::size_t tile, bool last,
                                    TileProgress& progress);

}  // namespace segsim::renderer::internal
