#pragma once

/// @file
/// A LiDAR cloud -> surfels to start training from, in the place of lift(): points are thinned
/// to one a voxel, normals come from their neighbours (PCL) and face the camera path, sizes
/// follow the spacing, and colours are those of the cloud or of the frames that see it.

#include "reconstruction/datasets/point_cloud_file.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "reconstruction/lifting/lifting.h"

namespace segsim::reconstruction {

/// @param cloud  In the source's coordinates: RgbdSequence::T_world_source() is applied.
/// @param options  voxel_m, neighbors, opacity, frame_step, held_out_every and threads count;
///     what is about depth images does not.
/// @return  As of lift(), without labels. Equal input gives equal output, whatever the number
///     of threads.
/// @throws core::InputError for fewer than 4 voxels, or if less than 1 % of the cloud lies
///     where the frames look: it is then in other coordinates than their poses.
[[nodiscard]] LiftResult start_from_cloud(const PointCloud& cloud,
                                          const RgbdSequence& sequence,
                                          const LiftOptions& options = {},
                                          const LiftProgress& progress = {});

}  // namespace segsim::reconstruction
