#pragma once

/// @file
/// Ceilings of worlds that are delivered open for a better view from above.

#include "sim/ground/mesh_scene.h"

namespace segsim::worlds::internal {

/// Whether something called a ceiling covers half of the world or more, seen from above.
[[nodiscard]] bool has_ceiling(const sim::MeshScene& scene);

/// Where a ceiling hangs, or could: the lowest point of the ceilings that are there, else the
/// top of the walls, else that of everything [m].
[[nodiscard]] double ceiling_height_m(const sim::MeshScene& scene);

/// Covers the room inside the walls, or the whole floor plan where they enclose nothing, with
/// a flat white ceiling. Inside is where nobody comes from outside without passing a wall that
/// reaches the height of `height_m` - 0.3 m, so doors need no leaf.
void add_flat_ceiling(sim::MeshScene& scene, double height_m);

}  // namespace segsim::worlds::internal
