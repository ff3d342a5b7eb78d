#pragma once

#include <optional>

#include "core/bundle_parts.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::sim {

/// The largest disc on the floor of a mesh that nothing reaches into between two heights, to
/// within the 2 cm cells in which collisions are tested. What has no floor counts as occupied.
/// @param lowest_m  What is lower is driven over. @param highest_m  Of what drives.
/// @return  nullopt if no cell of the floor is free.
[[nodiscard]] std::optional<core::FreeDisc> largest_free_disc(const TriangleMesh& mesh,
                                                              double lowest_m,
                                                              double highest_m);

}  // namespace segsim::sim
