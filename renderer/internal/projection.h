#pragma once

/// @file
/// Per frame: clusters in view, their surfels on the screen.

#include <cstdint>
#include <vector>

#include "renderer/internal/packed_surfels.h"
#include "renderer/internal/parallel.h"
#include "renderer/surfel_geometry.h"

namespace segsim::renderer::internal {

/// What the pixel loop reads for every surfel of a tile: one cache line.
struct alignas(64) ScreenSurfel {
  float x0_px, y0_px;
  float m00, m01, m10, m11, g0, g1;
  float z0_m, log2_opacity, k2;
  float e_min, e_max;                    ///< See inverse_depth_range(); used where needs_care.
  std::uint16_t x_lo, x_hi, y_lo, y_hi;  ///< Pixels whose centres the surfel can reach.
  std::uint32_t needs_care;  ///< Low pass, near plane or edge-on: not the plain formula.
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

/// Outline for the tile rows; syy < 0: use the pixel range instead.
using SurfelOutline = ScreenEllipse<float>;

/// Surfels of the visible clusters: cluster v fills slots [v * kClusterSize, ... + count[v]).
/// The arrays only grow.
struct ProjectedSurfels {
  std::vector<ScreenSurfel> screen;
  std::vector<SurfelShade> shade;
  std::vector<SurfelOutline> outline;
  std::vector<std::uint32_t> count;
  std::vector<std::uint32_t> visible_clusters;
};

struct ProjectionJob {
  const SurfelCloud& cloud;
  const PackedSurfels& packed;
  ProjectionCamera<float> camera;
  int width_px, height_px;
  float near_m;
  bool colours;
};

void project_surfels(const ProjectionJob& job, Workers& workers, ProjectedSurfels& projected);

}  // namespace segsim::renderer::internal
