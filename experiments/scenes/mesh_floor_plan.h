#pragma once

/// @file
/// The background of pictures for a world of meshes that has no surfels.

#include "experiments/drawing/floor_plan.h"
#include "sim/ground/mesh_scene.h"
#include "sim/ground/world.h"

namespace segsim::experiments::scenes {

/// Orthographic view from above of what lies below `max_height_m`, the highest in front. Walls
/// have no floor below them and stay white; where floor is an obstacle all the same (below
/// something tall), it is dark.
[[nodiscard]] drawing::FloorPlan make_mesh_floor_plan(const sim::MeshScene& scene,
                                                      const sim::World& world,
                                                      double max_height_m = 1.8,
                                                      double px_per_m = 64.0);

}  // namespace segsim::experiments::scenes
