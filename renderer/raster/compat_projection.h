#pragma once

/// @file
/// Projection under the rules of another 2DGS program (compat_rules.h), for the same tile and
/// pixel code. A checkpoint is looked at in these modes, not driven through, so this is plain
/// code: one surfel at a time in double precision, every cluster, 150 flops a surfel.
///
/// What its records mean where they differ from project_surfels():
///
///     field            meaning
///
///     shape            kInria or kGsplat
///
///     e_min, e_max     centre of the low pass, as an offset from (x0, y0) [px]
///
///     x_lo ... y_hi    all pixels of the tiles in which the program lists the surfel

#include <cstddef>

#include "renderer/raster/projection.h"
#include "renderer/scene/render_options.h"

namespace segsim::renderer::internal {

/// As find_visible_clusters(), but all clusters: the bounds of these programs may lie where no
/// part of a disc is seen.
void find_clusters_compat(const ProjectionJob& job, ProjectedSurfels& projected);

/// As project_clusters(). ProjectionJob::near_m and bounds are not used.
/// @param compat  Not kExact.
void project_clusters_compat(const ProjectionJob& job, Compat compat, std::size_t begin,
                             std::size_t end, Workers& workers, ProjectedSurfels& projected,
                             TileBins& bins);

}  // namespace segsim::renderer::internal
