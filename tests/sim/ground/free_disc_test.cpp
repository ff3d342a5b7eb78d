#include "sim/ground/free_disc.h"

#include <gtest/gtest.h>

#include "tests/box_mesh.h"

namespace segsim::sim {
namespace {

/// 4 m x 2 m with a box of 0.5 m in height over its left half, 0.3 m above the floor.
TriangleMesh room_with_a_shelf() {
  TriangleMesh mesh;
  append_floor(mesh, 0.0F, 0.0F, 4.0F, 2.0F);
  append_box(mesh, {0.0F, 0.0F, 0.3F}, {2.5F, 2.0F, 0.8F});
  return mesh;
}

TEST(FreeDisc, IsBoundedByTheEdgeOfTheFloor) {
  const auto disc = largest_free_disc(room_with_a_shelf(), 0.05, 0.25);
  ASSERT_TRUE(disc);
  EXPECT_NEAR(disc->radius_m, 1.0, 0.03);
  EXPECT_NEAR(disc->center_m.y, 1.0, 0.03);
}

TEST(FreeDisc, WhatReachesIntoTheHeightsIsOccupied) {
  const auto disc = largest_free_disc(room_with_a_shelf(), 0.05, 1.0);
  ASSERT_TRUE(disc);
  EXPECT_NEAR(disc->radius_m, 0.75, 0.03);
  EXPECT_NEAR(disc->center_m.x, 3.25, 0.03);
}

TEST(FreeDisc, ThereIsNoneWithoutFreeFloor) {
  EXPECT_FALSE(largest_free_disc(TriangleMesh{}, 0.05, 1.0));
  TriangleMesh shelf;
  append_box(shelf, {0.0F, 0.0F, 0.3F}, {2.0F, 2.0F, 0.8F});
  EXPECT_FALSE(largest_free_disc(shelf, 0.05, 1.0));
  TriangleMesh covered;
  append_floor(covered, 0.0F, 0.0F, 2.0F, 2.0F);
  append_box(covered, {-0.1F, -0.1F, 0.3F}, {2.1F, 2.1F, 0.8F});
  EXPECT_FALSE(largest_free_disc(covered, 0.05, 1.0));
}

}  // namespace
}  // namespace segsim::sim
