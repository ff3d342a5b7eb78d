#pragma once

/// @file
/// Per frame: clusters in view, their surfels on the screen.

#include <cstdint>
#include <vector>

#include "renderer/raster/tile_binning.h"
#include "renderer/raster/tile_size.h"
#include "renderer/scene/packed_surfels.h"
#include "renderer/scene/parallel.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::internal {

/// Which formula a surfel's pixels need.
enum class SurfelShape : std::uint32_t {
  kPlain,  ///< Beyond the near plane, and nowhere thinner than the low pass.
  kThin,   ///< The low pass matters.
  kCare,   ///< Reaches the near plane, or is so thin that its square form has no digits left.
  kInria,  ///< Compat::kInria: see compat_projection.h for the fields.
  kGsplat,
};

/// What the pixel loop reads for every surfel of a tile: one cache line. M' = M / k, so that
/// the disc ends at |q'|^2 = e^2.
struct alignas(64) ScreenSurfel {
  float x0_px, y0_px;
  float m00, m01, m10, m11, g0, g1;
  float z0_m;
  float c_k2;                            ///< k^2 / (2 ln 2): log2 of 255 times the opacity.
  float e_min, e_max;                    ///< See inverse_depth_range().
  std::uint16_t x_lo, x_hi, y_lo, y_hi;  ///< Pixels whose centres the surfel can reach.
  SurfelShape shape;
};
static_assert(sizeof(ScreenSurfel) == 64);

/// What it reads where the surfel is hit.
struct alignas(32) SurfelShade {
  float r, g, b;
  float nx, ny, nz;  ///< World frame, towards the camera.
  std::uint32_t label;
  std::uint32_t surfel;  ///< Index in the cloud: breaks ties of depth.
};
static_assert(sizeof(SurfelShade) == 32);

/// A cluster in view. No centre of its surfels is nearer than `nearest_m`, and none of them
/// reaches beyond `tiles`.
struct VisibleCluster {
  float nearest_m;
  std::uint32_t cluster;
  TileBox tiles;
};

/// Clusters that one task projects; the unit of everything that is done in parallel.
inline constexpr std::size_t kClustersPerTask = 32;

/// Surfels of the visible clusters, nearest cluster first: cluster v fills slots
/// [v * kClusterSize, ... + count[v]). The arrays only grow.
struct ProjectedSurfels {
  std::vector<ScreenSurfel> screen;
  std::vector<SurfelShade> shade;
  std::vector<std::uint32_t> count;
  std::vector<VisibleCluster> visible;

  /// Room for clusters [0, end).
  void reserve(std::size_t end);
};

struct ProjectionJob {
  const SurfelCloud& cloud;
  const PackedSurfels& packed;
  ProjectionCamera<float> camera;
  int width_px, height_px;
  float near_m;
  bool colours;
  TileBounds bounds = TileBounds::kAccuTile;
};

/// Of packed surfel i: its colour from the camera's direction (none unless the job wants any),
/// its normal turned to the camera.
[[nodiscard]] SurfelShade shade_of(const ProjectionJob& job, std::size_t i);

/// Finds the clusters in view, nearest first.
void find_visible_clusters(const ProjectionJob& job, ProjectedSurfels& projected);

/// Projects visible clusters [begin, end) and enters their surfels in the open slab of `bins`;
/// `begin` must be a multiple of kClustersPerTask.
void project_clusters(const ProjectionJob& job, std::size_t begin, std::size_t end,
                      Workers& workers, ProjectedSurfels& projected, TileBins& bins);

}  // namespace segsim::renderer::internal
