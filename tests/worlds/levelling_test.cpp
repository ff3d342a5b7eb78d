#include "worlds/surface/levelling.h"

#include <cmath>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/random.h"

namespace segsim::worlds {
namespace {

/// A floor of 5 m x 4 m, a table above it and a wall beside it, as small triangles: turned,
/// lifted and rough by up to `noise_m`.
sim::TriangleMesh scene(const glm::dquat& R, const glm::dvec3& t_m, double noise_m) {
  sim::TriangleMesh mesh;
  core::RandomStream random(4, "levelling");
  const auto patch = [&](const glm::dvec3& corner, const glm::dvec3& u, const glm::dvec3& v) {
    const int n = static_cast<int>(glm::length(u) / 0.05),
              m = static_cast<int>(glm::length(v) / 0.05);
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < m; ++j) {
        const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
        const glm::dvec3 lift =
            glm::normalize(glm::cross(u, v)) * noise_m * random.uniform(-1.0, 1.0);
        for (const auto& [a, b] : {std::pair{0, 0}, {1, 0}, {0, 1}}) {
          mesh.positions_m.emplace_back(R * (corner + u * ((i + a) / static_cast<double>(n)) +
                                             v * ((j + b) / static_cast<double>(m)) + lift) +
                                        t_m);
        }
        mesh.triangles.emplace_back(first, first + 1, first + 2);
      }
    }
  };
  patch({-2.5, -2, 0}, {5, 0, 0}, {0, 4, 0});
  patch({0, 0, 0.7}, {1.5, 0, 0}, {0, 1, 0});
  patch({2.5, -2, 0}, {0, 4, 0}, {0, 0, 2});
  return mesh;
}

TEST(Levelling, TiltedFloorIsPutToZero) {
  const glm::dquat R = glm::angleAxis(0.03, glm::normalize(glm::dvec3(1.0, 0.4, 0.0)));
  const glm::dvec3 t_m(0.1, -0.2, 0.07);
  const sim::TriangleMesh mesh = scene(R, t_m, 0.008);
  const auto found = find_levelling(mesh);
  ASSERT_TRUE(found.has_value());
  EXPECT_TRUE(found->applied);
  EXPECT_NEAR(found->tilt_rad, 0.03, 0.001);
  // Floor points p = R q + t with q.z = 0 come to z = 0.
  for (const glm::dvec3& q : {glm::dvec3(-2.5, -2, 0), {2.5, 2, 0}, {2.5, -2, 0}, {0, 0, 0}}) {
    EXPECT_NEAR((found->R_level * (R * q + t_m) + found->t_level_m).z, 0.0, 0.004);
  }
  // The floor's point over the origin is the new origin; there is no turn about z.
  const glm::dvec3 origin =
      found->R_level * glm::dvec3(0.0, 0.0, found->height_m) + found->t_level_m;
  EXPECT_LT(glm::length(origin), 1e-9);
  EXPECT_NEAR(found->R_level.z, 0.0, 1e-9);
}

TEST(Levelling, AFloorWithinToleranceIsLeftAlone) {
  const auto found = find_levelling(scene({1, 0, 0, 0}, {0, 0, 0.004}, 0.008));
  ASSERT_TRUE(found.has_value());
  EXPECT_FALSE(found->applied);
  EXPECT_EQ(found->R_level, glm::dquat(1, 0, 0, 0));
  EXPECT_EQ(found->t_level_m, glm::dvec3(0.0));
  EXPECT_NEAR(found->height_m, 0.004, 0.002);
  EXPECT_LT(found->tilt_rad, 0.002);
}

TEST(Levelling, SmallTiltsAreMeasured) {
  const glm::dquat R = glm::angleAxis(0.0008, glm::dvec3(0.0, 1.0, 0.0));
  const auto found = find_levelling(scene(R, {}, 0.0));
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->tilt_rad, 0.0008, 0.0001);
}

TEST(Levelling, WithoutAFloorThereIsNone) {
  EXPECT_FALSE(find_levelling(sim::TriangleMesh{}).has_value());
  EXPECT_FALSE(find_levelling(scene({1, 0, 0, 0}, {0, 0, 3.0}, 0.0)).has_value());
}

TEST(Levelling, PointsGiveTheSame) {
  const sim::TriangleMesh mesh = scene({1, 0, 0, 0}, {0, 0, 0.05}, 0.0);
  std::vector<glm::vec3> normals;
  for (const glm::vec3& p : mesh.positions_m) {
    normals.push_back(p.x < 2.49F ? glm::vec3(0, 0, 1) : glm::vec3(1, 0, 0));
  }
  const auto found = find_levelling(mesh.positions_m, normals);
  ASSERT_TRUE(found.has_value());
  EXPECT_TRUE(found->applied);
  EXPECT_NEAR(found->height_m, 0.05, 1e-4);
  EXPECT_NEAR(found->t_level_m.z, -0.05, 1e-4);
}

}  // namespace
}  // namespace segsim::worlds
