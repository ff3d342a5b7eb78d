#pragma once

/// @file
/// Small rooms with known measures, for the tests of this folder.

#include "sim/ground/triangle_mesh.h"
#include "tests/box_mesh.h"

namespace segsim::sim {

/// Floor [0, x] x [0, y] with 2 m high walls of 0.2 m outside of it.
inline TriangleMesh make_room(float x_m, float y_m) {
  TriangleMesh mesh;
  append_floor(mesh, -0.2F, -0.2F, x_m + 0.2F, y_m + 0.2F);
  append_box(mesh, {-0.2F, -0.2F, 0.0F}, {0.0F, y_m + 0.2F, 2.0F});
  append_box(mesh, {x_m, -0.2F, 0.0F}, {x_m + 0.2F, y_m + 0.2F, 2.0F});
  append_box(mesh, {0.0F, -0.2F, 0.0F}, {x_m, 0.0F, 2.0F});
  append_box(mesh, {0.0F, y_m, 0.0F}, {x_m, y_m + 0.2F, 2.0F});
  return mesh;
}

/// 6 m x 4 m with a 0.2 m wall at x = 3 that leaves the last 1.4 m (y > 2.6) open.
inline TriangleMesh make_two_rooms() {
  TriangleMesh mesh = make_room(6.0F, 4.0F);
  append_box(mesh, {2.9F, 0.0F, 0.0F}, {3.1F, 2.6F, 2.0F});
  return mesh;
}

}  // namespace segsim::sim
