#include "worlds/mesh/mesh_builder.h"

#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <tuple>

#include <gtest/gtest.h>

#include <glm/geometric.hpp>

namespace segsim::worlds {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;

/// Volume enclosed by a closed surface (divergence theorem); wrong windings make it wrong.
double volume_m3(const MeshBuilder& builder) {
  double volume = 0.0;
  for (const sim::SubMesh& mesh : builder.build(glm::mat4(1.0F), 1, 1)) {
    for (const glm::uvec3& t : mesh.triangles) {
      volume += glm::dot(mesh.positions_m[t.x],
                         glm::cross(mesh.positions_m[t.y], mesh.positions_m[t.z])) /
                6.0;
    }
  }
  return volume;
}

/// Directed edges by position: in a closed surface each occurs as often in one direction as in
/// the other.
bool is_closed(const MeshBuilder& builder) {
  using Key = std::tuple<long, long, long>;
  std::map<std::pair<Key, Key>, int> edges;
  for (const sim::SubMesh& mesh : builder.build(glm::mat4(1.0F), 1, 1)) {
    const auto key = [&](std::uint32_t i) {
      const glm::vec3 p = mesh.positions_m[i];
      return Key{std::lround(p.x * 1e5F), std::lround(p.y * 1e5F), std::lround(p.z * 1e5F)};
    };
    for (const glm::uvec3& t : mesh.triangles) {
      for (int k = 0; k < 3; ++k) {
        const Key a = key(t[k]), b = key(t[(k + 1) % 3]);
        a < b ? ++edges[{a, b}] : --edges[{b, a}];
      }
    }
  }
  for (const auto& [edge, balance] : edges) {
    if (balance != 0) return false;
  }
  return !edges.empty();
}

void expect_sound(const MeshBuilder& builder) {
  for (const sim::SubMesh& mesh : builder.build(glm::mat4(1.0F), 1, 1)) {
    for (const glm::vec3& n : mesh.normals) EXPECT_NEAR(glm::length(n), 1.0F, 1e-4F);
    for (const glm::uvec3& t : mesh.triangles) {
      const glm::vec3 cross = glm::cross(mesh.positions_m[t.y] - mesh.positions_m[t.x],
                                         mesh.positions_m[t.z] - mesh.positions_m[t.x]);
      EXPECT_GT(glm::length(cross), 0.0F);
      EXPECT_GE(glm::dot(cross, mesh.normals[t.x] + mesh.normals[t.y] + mesh.normals[t.z]),
                0.0F);
    }
  }
}

MeshBuilder fresh() {
  MeshBuilder builder;
  builder.set_surface({0, 0.5F});
  return builder;
}

TEST(MeshBuilder, BoxHasItsVolumeAndIsClosed) {
  MeshBuilder builder = fresh();
  builder.add_box({1.0F, -2.0F, 0.5F}, {0.4F, 0.6F, 1.0F});
  EXPECT_NEAR(volume_m3(builder), 0.24, 1e-5);
  EXPECT_TRUE(is_closed(builder));
  expect_sound(builder);
  EXPECT_EQ(builder.triangle_count(), 12U);
  EXPECT_NEAR(builder.min_m().y, -2.3F, 1e-6F);
  EXPECT_NEAR(builder.max_m().z, 1.0F, 1e-6F);
}

TEST(MeshBuilder, RoundedBoxApproachesMinkowskiSum) {
  const glm::vec3 size(0.6F, 0.5F, 0.4F);
  const float r = 0.1F;
  MeshBuilder builder = fresh();
  builder.add_rounded_box(glm::vec3(0.0F), size, r, 12);
  // Inner box + its faces thickened by r + quarter cylinders + a ball.
  const glm::vec3 i = size - 2.0F * r;
  const double expected = i.x * i.y * i.z + 2.0 * r * (i.x * i.y + i.y * i.z + i.z * i.x) +
                          kPi * r * r * (i.x + i.y + i.z) + 4.0 / 3.0 * kPi * r * r * r;
  EXPECT_NEAR(volume_m3(builder), expected, 2e-3 * expected);
  EXPECT_TRUE(is_closed(builder));
  expect_sound(builder);
  EXPECT_NEAR(builder.max_m().x, 0.3F, 1e-5F);
}

TEST(MeshBuilder, CylinderAndConeHaveTheirVolumes) {
  MeshBuilder cylinder = fresh(), cone = fresh();
  cylinder.add_cylinder({0, 0, 0}, {0.6F, 0.0F, 0.8F}, 0.2F, 0.2F, 128);
  cone.add_cylinder({0, 0, 0}, {0, 0, 1}, 0.3F, 0.0F, 128);
  EXPECT_NEAR(volume_m3(cylinder), kPi * 0.04, 1e-3 * kPi * 0.04);
  EXPECT_NEAR(volume_m3(cone), kPi * 0.09 / 3.0, 1e-3 * kPi * 0.03);
  EXPECT_TRUE(is_closed(cylinder));
  EXPECT_TRUE(is_closed(cone));
  expect_sound(cylinder);
  expect_sound(cone);
}

TEST(MeshBuilder, EllipsoidHasItsVolume) {
  MeshBuilder builder = fresh();
  builder.add_ellipsoid({1, 1, 1}, {0.3F, 0.2F, 0.4F}, 96);
  const double expected = 4.0 / 3.0 * kPi * 0.3 * 0.2 * 0.4;
  EXPECT_NEAR(volume_m3(builder), expected, 3e-3 * expected);
  EXPECT_TRUE(is_closed(builder));
  expect_sound(builder);
}

TEST(MeshBuilder, PrismHasItsVolume) {
  const std::array<glm::vec2, 6> outline{
      {{0, 0}, {1, 0}, {1.2F, 0.8F}, {0.6F, 0.7F}, {0.1F, 1}, {-0.2F, 0.5F}}};
  MeshBuilder builder = fresh();
  builder.add_prism(outline, 0.2F, 0.7F);
  double area = 0.0;  // Shoelace.
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const glm::vec2 a = outline[i], b = outline[(i + 1) % outline.size()];
    area += 0.5 * (a.x * b.y - b.x * a.y);
  }
  EXPECT_NEAR(volume_m3(builder), 0.5 * area, 1e-5);
  EXPECT_TRUE(is_closed(builder));
  expect_sound(builder);
}

TEST(MeshBuilder, LeafLiesBetweenItsEnds) {
  MeshBuilder builder = fresh();
  builder.add_leaf({0, 0, 1}, {1, 0, 0}, 0.5F, 0.1F, 0.5F, 6);
  expect_sound(builder);
  EXPECT_GT(builder.triangle_count(), 20U);
  EXPECT_LT(builder.max_m().x, 0.51F);
  EXPECT_LT(builder.min_m().z, 0.95F) << "it bends down";
  EXPECT_NEAR(builder.max_m().y, -builder.min_m().y, 1e-5F);
}

TEST(MeshBuilder, FrameAndPoseMoveParts) {
  MeshBuilder builder = fresh();
  builder.set_frame(pose_matrix({1, 0, 0}, 0.5F * kPi));
  builder.add_box({0.5F, 0, 0}, {0.2F, 0.2F, 0.2F});  // In the object at (1, 0.5, 0).
  const std::vector<sim::SubMesh> world = builder.build(pose_matrix({0, 0, 2}, kPi), 7, 9);
  ASSERT_EQ(world.size(), 1U);
  EXPECT_EQ(world[0].class_id, 7);
  EXPECT_EQ(world[0].instance_id, 9);
  glm::vec3 mean(0.0F);
  for (const glm::vec3& p : world[0].positions_m)
    mean += p / static_cast<float>(world[0].positions_m.size());
  EXPECT_NEAR(glm::length(mean - glm::vec3(-1.0F, -0.5F, 2.0F)), 0.0F, 1e-5F);
}

TEST(MeshBuilder, UvsAreMetresPerTile) {
  MeshBuilder builder = fresh();
  builder.add_quad({0, 0, 0}, {2, 0, 0}, {0, 0, 1});
  const sim::SubMesh mesh = builder.build(glm::mat4(1.0F), 1, 0)[0];
  EXPECT_FLOAT_EQ(mesh.uvs[2].x, 4.0F);
  EXPECT_FLOAT_EQ(mesh.uvs[2].y, 2.0F);
  EXPECT_FLOAT_EQ(mesh.normals[0].y, -1.0F);
}

TEST(MeshBuilder, MaterialsAreGrouped) {
  MeshBuilder builder = fresh();
  builder.add_box({0, 0, 0}, {1, 1, 1});
  builder.set_surface({5, 1.0F});
  builder.add_box({2, 0, 0}, {1, 1, 1});
  builder.set_surface({0, 1.0F});
  builder.add_box({4, 0, 0}, {1, 1, 1});
  const std::vector<sim::SubMesh> meshes = builder.build(glm::mat4(1.0F), 1, 1);
  ASSERT_EQ(meshes.size(), 2U);
  EXPECT_EQ(meshes[0].triangles.size(), 24U);
  EXPECT_EQ(meshes[1].material, 5);
}

}  // namespace
}  // namespace segsim::worlds
