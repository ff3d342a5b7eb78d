#pragma once

#include <vector>

#include "reconstruction/lifting/internal/voxel_cleaning.h"

namespace segsim::reconstruction::internal {

/// Closes holes in large flat surfaces (floor, walls, table tops): finds them with PCL, draws
/// each in a grid of voxel size, and lets the surface grow into empty cells that have it on
/// four of eight sides. A cell is filled only where no frame saw through it.
/// @return number of voxels added; `voxels` stays sorted by key.
std::size_t fill_planes(std::vector<Voxel>& voxels, const FreeSpace& free_space,
                        float voxel_m);

}  // namespace segsim::reconstruction::internal
