#include "sim/ground/ray_scene.h"

#include <array>
#include <limits>
#include <tuple>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/random.h"

namespace segsim::sim {
namespace {

/// Random triangles, each of which lies in two meshes: every hit is a tie.
MeshScene doubled_triangles(core::RandomStream& random, int count) {
  const auto place = [&] {
    return glm::vec3(random.uniform(-3, 3), random.uniform(-3, 3), random.uniform(-3, 3));
  };
  MeshScene scene;
  scene.materials.resize(1);
  SubMesh mesh;
  for (int i = 0; i < count; ++i) {
    const auto first = static_cast<unsigned int>(mesh.positions_m.size());
    const glm::vec3 corner = place();
    for (const glm::vec3& p : {corner, corner + 0.5F * place(), corner + 0.5F * place()}) {
      mesh.positions_m.push_back(p);
      mesh.normals.emplace_back(0, 0, 1);
      mesh.uvs.emplace_back(0, 0);
    }
    mesh.triangles.emplace_back(first, first + 1, first + 2);
  }
  scene.meshes = {mesh, mesh};
  return scene;
}

/// The first hit by looking at every triangle, with the plane's equation and areas.
RayHit brute_force(const MeshScene& scene, const glm::dvec3& origin,
                   const glm::dvec3& direction, double t_near, double t_far) {
  RayHit best;
  double best_t = t_far;
  for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
    const SubMesh& mesh = scene.meshes[m];
    for (std::size_t k = 0; k < mesh.triangles.size(); ++k) {
      const glm::dvec3 a(mesh.positions_m[mesh.triangles[k].x]);
      const glm::dvec3 b(mesh.positions_m[mesh.triangles[k].y]);
      const glm::dvec3 c(mesh.positions_m[mesh.triangles[k].z]);
      const glm::dvec3 n = glm::cross(b - a, c - a);
      const double t = glm::dot(a - origin, n) / glm::dot(direction, n);
      const glm::dvec3 p = origin + t * direction;
      const double u = glm::dot(glm::cross(p - a, c - a), n) / glm::dot(n, n);
      const double v = glm::dot(glm::cross(b - a, p - a), n) / glm::dot(n, n);
      if (u < 0 || v < 0 || u + v > 1 || t < t_near || t > best_t) continue;
      if (t == best_t && best.hit()) continue;
      best_t = t;
      best.t = static_cast<float>(t);
      best.mesh = static_cast<std::uint32_t>(m);
      best.triangle = static_cast<std::uint32_t>(k);
      best.u = static_cast<float>(u);
      best.v = static_cast<float>(v);
      best.normal = glm::normalize(n);
    }
  }
  return best;
}

void expect_equal(const RayHit& found, const RayHit& wanted) {
  ASSERT_EQ(found.hit(), wanted.hit());
  if (!wanted.hit()) return;
  EXPECT_EQ(found.mesh, wanted.mesh);
  EXPECT_EQ(found.triangle, wanted.triangle);
  EXPECT_NEAR(found.t, wanted.t, 1e-6F * wanted.t);
  EXPECT_NEAR(found.u, wanted.u, 1e-5F);
  EXPECT_NEAR(found.v, wanted.v, 1e-5F);
  EXPECT_LT(glm::distance(found.normal, wanted.normal), 1e-5F);
}

glm::vec3 random_direction(core::RandomStream& random) {
  return {random.normal(), random.normal(), random.normal()};
}

TEST(RayScene, TheFirstHitIsThatOfLookingAtEveryTriangle) {
  core::RandomStream random(1, "ray scene");
  const MeshScene scene = doubled_triangles(random, 60);
  const RayScene rays(scene, 1);
  int hits = 0;
  for (int i = 0; i < 2000; ++i) {
    const glm::vec3 direction = random_direction(random);
    const RayHit wanted = brute_force(scene, glm::dvec3(0.0), direction, 0.0, 1e30);
    hits += wanted.hit() ? 1 : 0;
    expect_equal(rays.cast({0, 0, 0}, direction), wanted);
  }
  EXPECT_GT(hits, 200);
}

TEST(RayScene, OfCoincidentSurfacesTheFirstMeshIsHit) {
  core::RandomStream random(2, "ray scene");
  const MeshScene scene = doubled_triangles(random, 60);
  const RayScene rays(scene, 1);
  int hits = 0;
  for (int i = 0; i < 250; ++i) {
    std::array<glm::vec3, 8> directions;
    for (glm::vec3& direction : directions) direction = random_direction(random);
    const auto packet = rays.cast8({0, 0, 0}, directions);
    for (std::size_t k = 0; k < 8; ++k) {
      const RayHit single = rays.cast({0, 0, 0}, directions[k]);
      EXPECT_EQ(std::tie(packet[k].t, packet[k].mesh, packet[k].triangle, packet[k].u),
                std::tie(single.t, single.mesh, single.triangle, single.u));
      if (!single.hit()) continue;
      ++hits;
      EXPECT_EQ(single.mesh, 0U);
    }
  }
  EXPECT_GT(hits, 200);
}

TEST(RayScene, OnlyHitsWithinTheRangeCount) {
  core::RandomStream random(3, "ray scene");
  const MeshScene scene = doubled_triangles(random, 60);
  const RayScene rays(scene, 1);
  int inside = 0, outside = 0;
  for (int i = 0; i < 1000; ++i) {
    const glm::vec3 direction = random_direction(random);
    const auto t_near = static_cast<float>(random.uniform(0.1, 1.5));
    const float t_far = t_near + static_cast<float>(random.uniform(0.1, 1.5));
    const RayHit wanted = brute_force(scene, glm::dvec3(0.0), direction, t_near, t_far);
    expect_equal(rays.cast({0, 0, 0}, direction, t_near, t_far), wanted);
    EXPECT_EQ(rays.occluded({0, 0, 0}, direction, t_near, t_far), wanted.hit());
    ++(wanted.hit() ? inside : outside);
  }
  EXPECT_GT(inside, 50);
  EXPECT_GT(outside, 50);
}

/// Embree ends the process on such numbers.
TEST(RayScene, NumbersBeyondAnyWorldAreRefused) {
  core::RandomStream random(4, "ray scene");
  MeshScene scene = doubled_triangles(random, 10);
  const RayScene rays(scene, 1);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const glm::vec3 ahead(1, 0, 0);
  for (const float far : {1e30F, -1e38F, RayScene::kFar, nan}) {
    EXPECT_THROW((void)rays.cast({far, 0, 0}, ahead), core::InputError) << far;
    EXPECT_THROW((void)rays.occluded({0, far, 0}, ahead, 0.0F, 1.0F), core::InputError);
    std::array<glm::vec3, 8> directions;
    directions.fill(ahead);
    EXPECT_THROW((void)rays.cast8({0, 0, far}, directions), core::InputError);
    directions[5].y = far;
    EXPECT_THROW((void)rays.cast8({0, 0, 0}, directions), core::InputError);
  }
  scene.meshes[1].positions_m[2].z = 1e30F;
  EXPECT_THROW(RayScene(scene, 1), core::InputError);
}

}  // namespace
}  // namespace segsim::sim
