#pragma once

#include <string>

namespace segsim::sim {

/// A single vertex that is far away would ask for more cells than there is memory.
/// @param place  For messages.
/// @throws core::InputError for a grid over the ground beyond core::kMostGroundCells.
void require_ground_cells(double cells_x, double cells_y, const std::string& place);

}  // namespace segsim::sim
