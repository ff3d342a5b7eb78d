#include "worlds/surface/mesh_distance.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/random.h"
#include "tests/box_mesh.h"
#include "worlds/mesh/plain_mesh.h"
#include "worlds/procedural/procedural_flat.h"
#include "worlds/surface/mesh_cleaning.h"

namespace segsim::worlds {
namespace {

TEST(MeshDistance, IsThatToTheBox) {
  sim::TriangleMesh box;
  sim::append_box(box, {-1, -2, 0}, {1, 2, 3});
  const MeshDistance distance(box);
  core::RandomStream random(1, "mesh_distance");
  for (int i = 0; i < 200; ++i) {
    const glm::dvec3 p(random.uniform(-3, 3), random.uniform(-4, 4), random.uniform(-2, 5));
    // Signed distance of a box, and its absolute value.
    const glm::dvec3 q = glm::abs(p - glm::dvec3(0, 0, 1.5)) - glm::dvec3(1, 2, 1.5);
    const double outside = glm::length(glm::max(q, glm::dvec3(0.0)));
    const double inside = std::min(std::max({q.x, q.y, q.z}), 0.0);
    EXPECT_NEAR(distance.to_m(glm::vec3(p)), std::abs(outside + inside), 1e-5);
  }
  EXPECT_THROW(MeshDistance(sim::TriangleMesh{}), core::InputError);
}

TEST(MeshDistance, SamplesLieOnTheirTrianglesAndClose) {
  sim::TriangleMesh box;
  sim::append_box(box, {-1, -2, 0}, {1, 2, 3});
  const SurfaceSamples samples = sample_surface(box, 0.1);
  const MeshDistance distance(box);
  for (std::size_t i = 0; i < samples.points_m.size(); ++i) {
    EXPECT_LT(distance.to_m(samples.points_m[i]), 1e-5);
    // The normals of a box point along one axis, outwards.
    EXPECT_GT(glm::dot(samples.normals[i], samples.points_m[i] - glm::vec3(0, 0, 1.5)), 0.9F);
  }
  // Any point of the box has a sample within the spacing.
  for (const glm::vec3& p : sample_surface(box, 0.37).points_m) {
    double nearest = 1.0;
    for (const glm::vec3& s : samples.points_m) {
      nearest = std::min(nearest, static_cast<double>(glm::distance(p, s)));
    }
    EXPECT_LT(nearest, 0.1);
  }
}

TEST(MeshDistance, PlainMeshHoldsAllTriangles) {
  const sim::MeshScene flat = make_flat({.seed = 3});
  const sim::TriangleMesh mesh = plain_mesh(flat);
  EXPECT_EQ(mesh.triangles.size(), flat.triangle_count());
  for (const glm::uvec3& t : mesh.triangles) {
    EXPECT_LT(std::max({t.x, t.y, t.z}), mesh.positions_m.size());
  }
}

}  // namespace
}  // namespace segsim::worlds
