#include "worlds/surface/mesh_cleaning.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "tests/worlds/depth_scenes.h"

namespace segsim::worlds {
namespace {

/// A box whose eight corners are shared by its faces.
sim::TriangleMesh closed_box(const glm::vec3& at_m, float side_m) {
  sim::TriangleMesh mesh;
  for (int c = 0; c < 8; ++c) {
    mesh.positions_m.push_back(at_m + side_m * glm::vec3(c & 1, c >> 1 & 1, c >> 2));
  }
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return mesh;
}

void append(sim::TriangleMesh& mesh, const sim::TriangleMesh& other) {
  const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
  mesh.positions_m.insert(mesh.positions_m.end(), other.positions_m.begin(),
                          other.positions_m.end());
  for (const glm::uvec3& t : other.triangles) mesh.triangles.push_back(t + first);
}

TEST(MeshCleaning, CountsEdges) {
  sim::TriangleMesh box = closed_box({0, 0, 0}, 1.0F);
  EdgeCounts edges = count_edges(box);
  EXPECT_EQ(edges.inner, 18U);
  EXPECT_EQ(edges.open + edges.irregular, 0U);
  box.triangles.pop_back();
  edges = count_edges(box);
  EXPECT_EQ(edges.inner, 15U);
  EXPECT_EQ(edges.open, 3U);
  box = closed_box({0, 0, 0}, 1.0F);
  std::swap(box.triangles[0].y, box.triangles[0].z);  // Faces the other way.
  EXPECT_EQ(count_edges(box).irregular, 3U);
  EXPECT_EQ(count_edges({}).total(), 0U);
}

TEST(MeshCleaning, SmallPiecesGoAndLargeOnesStayWhole) {
  sim::TriangleMesh mesh = closed_box({5, 0, 0}, 0.1F);  // 0.06 m2
  append(mesh, closed_box({0, 0, 0}, 1.0F));             // 6 m2
  append(mesh, closed_box({7, 0, 0}, 0.05F));
  EXPECT_EQ(remove_small_pieces(mesh, 0.1), 2U);
  const sim::TriangleMesh expected = closed_box({0, 0, 0}, 1.0F);
  ASSERT_EQ(mesh.triangles.size(), 12U);
  EXPECT_EQ(mesh.positions_m.size(), 8U);
  EXPECT_EQ(count_edges(mesh).inner, 18U);
  for (const glm::vec3& p : mesh.positions_m) {
    EXPECT_NE(std::find(expected.positions_m.begin(), expected.positions_m.end(), p),
              expected.positions_m.end());
  }
  EXPECT_EQ(remove_small_pieces(mesh, 0.1), 0U);
  EXPECT_EQ(remove_small_pieces(mesh, 10.0), 1U);
  EXPECT_TRUE(mesh.positions_m.empty());
}

TEST(MeshCleaning, DecimatedRoomKeepsItsWallsAndStaysClosed) {
  const glm::dvec3 lo(-1.5, -1.2, 0.0), hi(1.8, 1.4, 2.4);
  const sim::TriangleMesh mesh = fused(look_outwards(room_shape(lo, hi), {0.1, 0.0, 1.2}));
  const EdgeCounts before = count_edges(mesh);
  const sim::TriangleMesh fewer = decimated(mesh, 0.01);
  EXPECT_LT(fewer.triangles.size(), mesh.triangles.size() / 5);
  const EdgeCounts edges = count_edges(fewer);
  EXPECT_EQ(edges.irregular, 0U);
  EXPECT_EQ(edges.open, before.open);
  for (const glm::uvec3& t : fewer.triangles) {
    const glm::dvec3 p =
        (glm::dvec3(fewer.positions_m[t.x]) + glm::dvec3(fewer.positions_m[t.y]) +
         glm::dvec3(fewer.positions_m[t.z])) /
        3.0;
    const glm::dvec3 d = glm::min(glm::abs(p - lo), glm::abs(p - hi));
    EXPECT_LT(std::min({d.x, d.y, d.z}), 0.01 + 0.03 / 4);
  }
  EXPECT_TRUE(decimated({}, 0.01).triangles.empty());
  EXPECT_EQ(decimated(fewer, 0.0).triangles, fewer.triangles);
}

}  // namespace
}  // namespace segsim::worlds
