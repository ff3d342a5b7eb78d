#include "worlds/surface/depth_fusion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "core/check.h"
#include "core/error.h"
#include "tests/worlds/depth_scenes.h"
#include "worlds/surface/mesh_cleaning.h"

namespace segsim::worlds {
namespace {

constexpr double kVoxel_m = 0.03;

/// Largest |f(p)| over vertices and middles of triangles.
template <class F>
double largest_error_m(const sim::TriangleMesh& mesh, const F& f) {
  double worst = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    const glm::dvec3 a(mesh.positions_m[t.x]), b(mesh.positions_m[t.y]),
        c(mesh.positions_m[t.z]);
    for (const glm::dvec3& p : {a, b, c, (a + b + c) / 3.0}) {
      worst = std::max(worst, std::abs(f(p)));
    }
  }
  return worst;
}

double total_area_m2(const sim::TriangleMesh& mesh) {
  double area = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    const glm::dvec3 a(mesh.positions_m[t.x]), b(mesh.positions_m[t.y]),
        c(mesh.positions_m[t.z]);
    area += 0.5 * glm::length(glm::cross(b - a, c - a));
  }
  return area;
}

bool same(const sim::TriangleMesh& a, const sim::TriangleMesh& b) {
  return a.positions_m == b.positions_m && a.triangles == b.triangles;
}

TEST(DepthFusion, OneViewOfASlantedPlaneGivesThatPlane) {
  const glm::dvec3 n = glm::normalize(glm::dvec3(-0.8, 0.3, 0.6));
  DepthFusionOptions options;
  options.min_weight = 0.2;
  const sim::TriangleMesh mesh =
      fused({look(plane_shape(n, -1.0), {0, 0, 0}, {1, 0, -0.2})}, options);
  ASSERT_GT(mesh.triangles.size(), 1000U);
  EXPECT_LT(largest_error_m(mesh, [&](const glm::dvec3& p) { return glm::dot(n, p) + 1.0; }),
            kVoxel_m / 4);
  // One view cannot close anything, but it must not tear either.
  const EdgeCounts edges = count_edges(mesh);
  EXPECT_GT(edges.open, 0U);
  EXPECT_EQ(edges.irregular, 0U);
  EXPECT_LT(edges.open, edges.inner / 10);
}

TEST(DepthFusion, TrianglesFaceTheCamera) {
  DepthFusionOptions options;
  options.min_weight = 0.2;
  const sim::TriangleMesh mesh =
      fused({look(plane_shape({0, 0, 1}, 0.0), {0, 0, 1.5}, {1, 0, 0})}, options);
  ASSERT_FALSE(mesh.triangles.empty());
  for (const glm::uvec3& t : mesh.triangles) {
    const glm::vec3 normal = glm::cross(mesh.positions_m[t.y] - mesh.positions_m[t.x],
                                        mesh.positions_m[t.z] - mesh.positions_m[t.x]);
    EXPECT_GE(normal.z, 0.0F);
  }
}

TEST(DepthFusion, SphereIsClosedAndWithinAQuarterVoxel) {
  const glm::dvec3 center(0.2, -0.1, 1.0);
  const sim::TriangleMesh mesh = fused(look_around(sphere_shape(center, 0.6), center, 2.0));
  ASSERT_GT(mesh.triangles.size(), 1000U);
  EXPECT_LT(largest_error_m(
                mesh, [&](const glm::dvec3& p) { return glm::distance(p, center) - 0.6; }),
            kVoxel_m / 4);
  const EdgeCounts edges = count_edges(mesh);
  EXPECT_EQ(edges.open, 0U);
  EXPECT_EQ(edges.irregular, 0U);
  EXPECT_NEAR(total_area_m2(mesh), 4.0 * std::numbers::pi * 0.36, 0.02 * 4.5);
  // Euler: V - E + F = 2.
  EXPECT_EQ(mesh.positions_m.size() + mesh.triangles.size(), edges.total() + 2U);
}

TEST(DepthFusion, RoomIsClosedAndWithinAQuarterVoxelOfItsWalls) {
  const glm::dvec3 lo(-1.5, -1.2, 0.0), hi(1.8, 1.4, 2.4);
  std::vector<ShapeView> views = look_outwards(room_shape(lo, hi), {0.1, 0.0, 1.2});
  for (const ShapeView& view : look_outwards(room_shape(lo, hi), {-0.7, 0.5, 1.0}, 0.0, 100)) {
    views.push_back(view);
  }
  const sim::TriangleMesh mesh = fused(views);
  ASSERT_GT(mesh.triangles.size(), 10000U);
  const EdgeCounts edges = count_edges(mesh);
  EXPECT_EQ(edges.open, 0U);
  EXPECT_EQ(edges.irregular, 0U);
  // Marching cubes cuts the corners off, by less than a voxel; what is more than two voxels
  // from a corner must lie on its wall.
  const auto to_wall = [&](const glm::dvec3& p, bool near_corners) {
    const glm::dvec3 d = glm::min(glm::abs(p - lo), glm::abs(p - hi));
    std::array<double, 3> sorted = {d.x, d.y, d.z};
    std::sort(sorted.begin(), sorted.end());
    return near_corners || sorted[1] > 2.0 * kVoxel_m ? sorted[0] : 0.0;
  };
  EXPECT_LT(largest_error_m(mesh, [&](const glm::dvec3& p) { return to_wall(p, false); }),
            kVoxel_m / 4);
  EXPECT_LT(largest_error_m(mesh, [&](const glm::dvec3& p) { return to_wall(p, true); }),
            kVoxel_m);
  const glm::dvec3 e = hi - lo;
  EXPECT_NEAR(total_area_m2(mesh), 2.0 * (e.x * e.y + e.x * e.z + e.y * e.z), 0.5);
}

TEST(DepthFusion, NoiseAveragesOut) {
  const glm::dvec3 center(0.0, 0.0, 0.0);
  std::vector<ShapeView> views;
  for (int i = 0; i < 3; ++i) {
    const double distance_m = 1.8 + 0.2 * i;
    for (ShapeView& v : look_around(sphere_shape(center, 0.6), center, distance_m, 0.005)) {
      views.push_back(std::move(v));
    }
  }
  sim::TriangleMesh mesh = fused(views);
  remove_small_pieces(mesh, 0.05);
  double sum = 0.0;
  for (const glm::vec3& p : mesh.positions_m) {
    sum += std::abs(glm::length(glm::dvec3(p)) - 0.6);
  }
  EXPECT_LT(sum / static_cast<double>(mesh.positions_m.size()), 0.004);
  EXPECT_LT(largest_error_m(mesh, [&](const glm::dvec3& p) { return glm::length(p) - 0.6; }),
            0.03);
  EXPECT_EQ(count_edges(mesh).irregular, 0U);
}

TEST(DepthFusion, BothFacesOfAThinBoardStayWhereTheyAre) {
  // 6 cm: thinner than the truncation.
  const auto board = [](const glm::dvec3& o, const glm::dvec3& d) {
    return plane_shape({1, 0, 0}, o.x > 0.0 ? 0.03 : -0.03)(o, d);
  };
  std::vector<ShapeView> views;
  for (const double y : {-0.4, 0.0, 0.4}) {
    views.push_back(look(board, {1.2, y, 0.0}, {0.0, y, 0.0}));
    views.push_back(look(board, {-1.2, y, 0.0}, {0.0, y, 0.0}));
  }
  const sim::TriangleMesh mesh = fused(views);
  std::size_t front = 0;
  for (const glm::vec3& p : mesh.positions_m) {
    EXPECT_NEAR(std::abs(p.x), 0.03, kVoxel_m / 4);
    front += p.x > 0.0F ? 1 : 0;
  }
  EXPECT_GT(front, mesh.positions_m.size() / 3);
  EXPECT_LT(front, 2 * mesh.positions_m.size() / 3);
}

TEST(DepthFusion, PixelsThatAreNoDepthAreUnknown) {
  const RayShape wall = plane_shape({1, 0, 0}, 2.0);
  ShapeView view = look(wall, {0, 0, 0}, {1, 0, 0});
  DepthFusionOptions options;
  options.min_weight = 0.2;
  // A stripe of each kind of nonsense; the rest must not notice.
  const std::array<float, 5> nonsense = {std::numeric_limits<float>::quiet_NaN(),
                                         std::numeric_limits<float>::infinity(),
                                         -std::numeric_limits<float>::infinity(), 0.0F, -2.0F};
  for (int y = 0; y < 120; ++y) {
    for (int i = 0; i < 20; ++i)
      view.depth_m(70 + i, y) = nonsense[static_cast<std::size_t>(i) % 5];
  }
  const sim::TriangleMesh mesh = fused({view}, options);
  ASSERT_FALSE(mesh.triangles.empty());
  EXPECT_LT(largest_error_m(mesh, [](const glm::dvec3& p) { return p.x - 2.0; }),
            kVoxel_m / 4);
  // The stripe is 0.5 m wide around y = 0 (image x = 80 is its middle).
  for (const glm::vec3& p : mesh.positions_m) EXPECT_GT(std::abs(p.y), 0.2F);
}

TEST(DepthFusion, NothingGivesNothing) {
  EXPECT_TRUE(DepthFusion().surface().triangles.empty());
  ShapeView view = look(plane_shape({1, 0, 0}, 2.0), {0, 0, 0}, {1, 0, 0});
  std::fill(view.depth_m.pixels().begin(), view.depth_m.pixels().end(),
            std::numeric_limits<float>::quiet_NaN());
  const sim::TriangleMesh mesh = fused({view});
  EXPECT_TRUE(mesh.positions_m.empty());
  EXPECT_TRUE(mesh.triangles.empty());
}

TEST(DepthFusion, EqualForAnyNumberOfThreads) {
  const glm::dvec3 center(0.0, 0.0, 1.0);
  const auto views = look_around(sphere_shape(center, 0.5), center, 1.7, 0.004);
  DepthFusionOptions options;
  options.threads = 1;
  const sim::TriangleMesh one = fused(views, options);
  ASSERT_FALSE(one.triangles.empty());
  for (const int threads : {2, 4}) {
    options.threads = threads;
    EXPECT_TRUE(same(one, fused(views, options))) << threads;
  }
}

TEST(DepthFusion, SurfaceAcrossPiecesAndNegativePlacesIsWhole) {
  // A wall of 6 m: several pieces of marching cubes to both sides of the origin.
  DepthFusionOptions options;
  options.min_weight = 0.2;
  const sim::TriangleMesh mesh =
      fused({look(plane_shape({1, 0, 0}, 3.01), {0, 0, 0}, {1, 0, 0})}, options);
  const EdgeCounts edges = count_edges(mesh);
  EXPECT_EQ(edges.irregular, 0U);
  // Open edges are those of one rectangle: its 2 x (6 + 4.5) m, in voxels, twice at most.
  EXPECT_LT(static_cast<double>(edges.open), 2.0 * 21.0 / kVoxel_m);
  EXPECT_NEAR(total_area_m2(mesh), 6.0 * 4.5, 1.0);
}

TEST(DepthFusion, ReservedViewsCarveWhatAppearsLate) {
  // Three views see a wall at 2 m; a fourth claims a surface at 1 m that the others saw
  // through.
  std::vector<ShapeView> views;
  for (const double y : {-0.1, 0.0, 0.1}) {
    views.push_back(look(plane_shape({1, 0, 0}, 2.0), {0, y, 0}, {1, y, 0}));
  }
  views.push_back(look(plane_shape({1, 0, 0}, 1.0), {0, 0, 0}, {1, 0, 0}));
  DepthFusionOptions options;
  options.min_weight = 0.2;
  const auto phantom = [](const sim::TriangleMesh& mesh) {
    return std::count_if(mesh.positions_m.begin(), mesh.positions_m.end(),
                         [](const glm::vec3& p) { return p.x < 1.5F; });
  };
  EXPECT_GT(phantom(fused(views, options)), 1000);
  DepthFusion fusion(options);
  for (const ShapeView& view : views) fusion.reserve(view.view());
  EXPECT_TRUE(fusion.surface().triangles.empty());
  for (const ShapeView& view : views) fusion.add_reserved(view.view());
  DepthFusion looking_again(options);
  for (const ShapeView& view : views) looking_again.reserve(view.view());
  for (const ShapeView& view : views) looking_again.add(view.view());
  EXPECT_EQ(fusion.surface().positions_m, looking_again.surface().positions_m);
  EXPECT_EQ(fusion.surface().triangles, looking_again.surface().triangles);
  // The part that all three saw through is gone; they did not see the outermost rim.
  EXPECT_LT(phantom(fusion.surface()), phantom(fused(views, options)) / 5);
}

TEST(DepthFusion, GivenNormalsAreUsed) {
  ShapeView view = look(plane_shape({1, 0, 0}, 2.0), {0, 0, 0}, {1, 0, 0});
  const core::Image<glm::vec3> none(160, 120, glm::vec3(0.0F));
  const core::Image<glm::vec3> right(160, 120, glm::vec3(-1.0F, 0.0F, 0.0F));
  DepthFusionOptions options;
  options.min_weight = 0.2;
  DepthFusion without(options), with(options);
  without.add({view.intrinsics, view.T_world_camera, &view.depth_m, &none});
  with.add({view.intrinsics, view.T_world_camera, &view.depth_m, &right});
  EXPECT_TRUE(without.surface().triangles.empty());
  EXPECT_GT(with.surface().triangles.size(), 1000U);
}

TEST(DepthFusion, MemoryIsBounded) {
  const ShapeView view = look(plane_shape({1, 0, 0}, 2.0), {0, 0, 0}, {1, 0, 0});
  DepthFusionOptions options;
  options.max_blocks = 10;
  DepthFusion fusion(options);
  EXPECT_THROW(fusion.add(view.view()), core::InputError);
  ShapeView far = view;
  far.T_world_camera = core::look_at({1e6, 0, 0}, {1e6 + 1, 0, 0});
  EXPECT_THROW(DepthFusion().add(far.view()), core::InputError);
}

TEST(DepthFusion, RefusesOptionsAndSizesThatCannotBe) {
  DepthFusionOptions options;
  options.truncation_m = options.voxel_m;
  EXPECT_THROW(DepthFusion{options}, core::ContractViolation);
  ShapeView view = look(plane_shape({1, 0, 0}, 2.0), {0, 0, 0}, {1, 0, 0});
  view.depth_m = core::Image<float>(10, 10, 1.0F);
  EXPECT_THROW(DepthFusion().add(view.view()), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::worlds
