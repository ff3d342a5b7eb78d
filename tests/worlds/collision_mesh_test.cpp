#include "worlds/surface/collision_mesh.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "core/error.h"
#include "core/random.h"
#include "sim/ground/world.h"
#include "tests/box_mesh.h"
#include "worlds/surface/voxel_faces.h"

namespace segsim::worlds {
namespace {

/// Noisy points of a 5 m x 4 m room, 2 cm apart, with a box in it; the walls are 1.8 m high.
struct NoisyRoom {
  std::vector<glm::vec3> points, normals;
  core::RandomStream random{11, "room"};
  float noise_m = 0.008F;

  void add(const glm::vec3& p, const glm::vec3& n) {
    points.push_back(p + n * noise_m * static_cast<float>(random.normal()));
    normals.push_back(n);
  }
  /// @param hole  Share of floor points that are missing, in patches of 0.2 m.
  explicit NoisyRoom(double hole) {
    constexpr float kStep = 0.02F;
    for (float x = 0.01F; x < 5.0F; x += kStep) {
      for (float y = 0.01F; y < 4.0F; y += kStep) {
        core::RandomStream patch(1, "hole",
                                 static_cast<std::uint64_t>(int(x * 5) * 100 + int(y * 5)));
        const bool under_box = x > 2.0F && x < 3.0F && y > 1.0F && y < 2.0F;
        if (!under_box && !patch.chance(hole)) add({x, y, 0}, {0, 0, 1});
      }
    }
    for (float z = 0.01F; z < 1.8F; z += kStep) {
      for (float x = 0.0F; x < 5.0F; x += kStep) {
        add({x, 0, z}, {0, 1, 0});
        add({x, 4, z}, {0, -1, 0});
      }
      for (float y = 0.0F; y < 4.0F; y += kStep) {
        add({0, y, z}, {1, 0, 0});
        add({5, y, z}, {-1, 0, 0});
      }
    }
    for (float a = 0.0F; a < 1.0F; a += kStep) {
      for (float b = 0.0F; b < 0.8F; b += kStep) {
        add({2.0F, 1.0F + a, b}, {-1, 0, 0});
        add({3.0F, 1.0F + a, b}, {1, 0, 0});
        add({2.0F + a, 1.0F, b}, {0, -1, 0});
        add({2.0F + a, 2.0F, b}, {0, 1, 0});
      }
      for (float b = 0.0F; b < 1.0F; b += kStep) add({2.0F + a, 1.0F + b, 0.8F}, {0, 0, 1});
    }
  }
};

double analytic_free_area(double radius_m) {
  const double room = (5.0 - 2 * radius_m) * (4.0 - 2 * radius_m);
  const double box = 1.0 + 4 * radius_m + 3.14159 * radius_m * radius_m;
  return room - box;
}

TEST(CollisionMesh, FreeSpaceOfANoisyRoomWithHoles) {
  NoisyRoom room(0.37);
  // Floaters in the middle of free space, and a lone speck cloud.
  for (int k = 0; k < 30; ++k) {
    room.points.emplace_back(1.0F + 0.002F * static_cast<float>(k % 10), 3.0F,
                             0.5F + 0.002F * static_cast<float>(k));
    room.normals.emplace_back(1, 0, 0);
    room.points.emplace_back(room.random.uniform(0.3, 1.7), room.random.uniform(0.3, 3.7),
                             room.random.uniform(0.2, 1.5));
    room.normals.emplace_back(1, 0, 0);
  }
  const CollisionMeshResult result = make_collision_mesh(room.points, room.normals, {});
  EXPECT_TRUE(result.warnings.empty()) << result.warnings.front();
  EXPECT_NEAR(result.floor_height_m, 0.0, 0.01);
  EXPECT_LT(result.floor_tilt_rad, 0.02);
  EXPECT_GT(result.floor_m2, 1.2 * result.floor_seen_m2) << "holes are closed";
  EXPECT_GT(result.outliers + result.floaters, 30U);
  EXPECT_LT(result.mesh.triangles.size(), 100000U);

  const sim::RobotModel robot = sim::RobotModel::jackal();
  const sim::World world = sim::World::from_mesh(result.mesh, robot);
  const double expected_m2 = analytic_free_area(robot.circumscribed_radius_m());
  EXPECT_NEAR(world.free_space().area_m2(1), expected_m2, 0.12 * expected_m2);
  EXPECT_NEAR(world.navmesh().island_areas_m2()[0], expected_m2, 0.2 * expected_m2);
  EXPECT_TRUE(world.collision().collides({2.5, 1.5, 0.0})) << "the box";
  EXPECT_TRUE(world.collision().collides({4.9, 3.0, 0.0})) << "the wall";
  EXPECT_FALSE(world.collision().collides({1.0, 3.0, 0.3})) << "the floater is gone";
}

TEST(CollisionMesh, WhereSomebodyWalkedThereIsFloor) {
  NoisyRoom room(0.0);
  // Cut a band of 0.9 m out of the floor: more than closing bridges.
  std::vector<glm::vec3> points, normals;
  for (std::size_t k = 0; k < room.points.size(); ++k) {
    const glm::vec3& p = room.points[k];
    if (std::abs(p.z) < 0.05F && p.x > 3.5F && p.x < 4.4F) continue;
    points.push_back(p);
    normals.push_back(room.normals[k]);
  }
  sim::RobotModel robot = sim::RobotModel::jackal();
  const sim::World without =
      sim::World::from_mesh(make_collision_mesh(points, normals, {}).mesh, robot);
  EXPECT_FALSE(without.free_space().is_free({3.95, 3.0}));
  std::vector<glm::dvec3> cameras;
  for (double x = 3.3; x < 4.6; x += 0.05) {
    for (double y = 2.5; y < 3.5; y += 0.2) cameras.emplace_back(x, y, 1.6);
  }
  const sim::World with =
      sim::World::from_mesh(make_collision_mesh(points, normals, cameras).mesh, robot);
  EXPECT_TRUE(with.free_space().is_free({3.95, 3.0}));
}

TEST(CollisionMesh, WarnsOfAFloorThatIsNotAtZero) {
  NoisyRoom room(0.0);
  for (glm::vec3& p : room.points) p.z += 0.07F;
  CollisionMeshOptions options;
  options.floor_band_m = 0.12;
  const CollisionMeshResult result =
      make_collision_mesh(room.points, room.normals, {}, options);
  EXPECT_NEAR(result.floor_height_m, 0.07, 0.01);
  EXPECT_EQ(result.warnings.size(), 1U);
}

TEST(CollisionMesh, RefusesPointsWithoutFloorOrTooFarApart) {
  EXPECT_THROW((void)make_collision_mesh({}, {}, {}), core::InputError);
  const std::vector<glm::vec3> high = {{0, 0, 1}, {1, 1, 1}};
  EXPECT_THROW((void)make_collision_mesh(high, {}, {}), core::InputError);
  const std::vector<glm::vec3> wide = {{0, 0, 0}, {1000, 1, 0}};
  EXPECT_THROW((void)make_collision_mesh(wide, {}, {}), core::InputError);
}

TEST(CollisionMesh, CamerasAloneAreAFloorOnlyIfSomebodySaysSo) {
  std::vector<glm::vec3> wall, normals;
  for (float x = 0.0F; x < 3.0F; x += 0.02F) {
    for (float z = 0.5F; z < 1.8F; z += 0.02F) {
      wall.emplace_back(x, 2.0F, z);
      normals.emplace_back(0, -1, 0);
    }
  }
  const std::vector<glm::dvec3> cameras = {{1.0, 0.5, 1.3}, {1.5, 0.5, 1.3}};
  CollisionMeshOptions options;
  EXPECT_THROW((void)make_collision_mesh(wall, normals, cameras, options), core::InputError);
  options.floor_is_known = true;
  EXPECT_GT(make_collision_mesh(wall, normals, cameras, options).floor_m2, 0.5);
}

/// The room of above as a surface: rough floor with a hole under the box, nothing below z = 0.
sim::TriangleMesh rough_surface() {
  sim::TriangleMesh mesh;
  core::RandomStream random(3, "surface");
  for (int i = 0; i < 50; ++i) {
    for (int j = 0; j < 40; ++j) {
      if (i >= 20 && i < 30 && j >= 10 && j < 20) continue;
      const float x = 0.1F * static_cast<float>(i), y = 0.1F * static_cast<float>(j);
      sim::append_floor(mesh, x, y, x + 0.1F, y + 0.1F,
                        static_cast<float>(random.uniform(-0.03, 0.05)));
    }
  }
  sim::append_box(mesh, {2.0F, 1.0F, 0.0F}, {3.0F, 2.0F, 0.8F});
  sim::append_box(mesh, {-0.05F, -0.05F, 0.0F}, {0.0F, 4.05F, 2.4F});
  sim::append_box(mesh, {5.0F, -0.05F, 0.0F}, {5.05F, 4.05F, 2.4F});
  sim::append_box(mesh, {0.0F, -0.05F, 0.0F}, {5.0F, 0.0F, 2.4F});
  sim::append_box(mesh, {0.0F, 4.0F, 0.0F}, {5.0F, 4.05F, 2.4F});
  sim::append_floor(mesh, 0.0F, 0.0F, 5.0F, 4.0F, 2.4F);  // A ceiling.
  return mesh;
}

TEST(CollisionMesh, FreeSpaceOfASurface) {
  const sim::RobotModel robot = sim::RobotModel::jackal_gentle();
  const CollisionMeshResult made = collision_mesh_of_surface(rough_surface(), {});
  EXPECT_TRUE(made.warnings.empty());
  // 5.2 m x 4.2 m: the room and the cells that its walls touch. The hole of 1 m2 under the box
  // is closed.
  EXPECT_NEAR(made.floor_m2, 5.2 * 4.2, 0.5);
  for (const glm::uvec3& t : made.mesh.triangles) {
    float lowest = 10.0F, highest = -10.0F;
    for (int i = 0; i < 3; ++i) {
      lowest = std::min(lowest, made.mesh.positions_m[t[i]].z);
      highest = std::max(highest, made.mesh.positions_m[t[i]].z);
    }
    EXPECT_LT(lowest, 1.9F);                          // No ceiling ...
    EXPECT_TRUE(highest == 0.0F || highest > 0.08F);  // ... and one level floor.
  }
  const sim::World world = sim::World::from_mesh(made.mesh, robot);
  const double radius_m = world.free_space().radius_m;
  EXPECT_NEAR(world.free_space().area_m2(), analytic_free_area(radius_m), 0.5);
}

TEST(CollisionMesh, RefusesASurfaceWithoutFloor) {
  sim::TriangleMesh wall;
  sim::append_box(wall, {0, 0, 0.5F}, {1, 1, 1.5F});
  EXPECT_THROW((void)collision_mesh_of_surface(wall, {}), core::InputError);
  EXPECT_THROW((void)collision_mesh_of_surface(sim::TriangleMesh{}, {}), core::InputError);
}

TEST(MergeCells, CoversExactlyTheMask) {
  core::RandomStream random(9, "mask");
  for (int trial = 0; trial < 20; ++trial) {
    sim::GridMask mask(13, 11, 0);
    for (auto& value : mask.pixels()) value = random.chance(0.6) ? 1 : 0;
    const sim::GridMask before = mask;
    sim::GridMask covered(13, 11, 0);
    for (const CellRectangle& r : merge_cells(mask)) {
      for (int j = r.j0; j < r.j1; ++j) {
        for (int i = r.i0; i < r.i1; ++i) ++covered(i, j);
      }
    }
    EXPECT_EQ(covered.pixels(), before.pixels());
  }
}

TEST(ExposedFaces, EncloseTheVolumeOfTheVoxels) {
  core::RandomStream random(10, "voxels");
  VoxelBox box;
  box.origin_m = {1, 2, 3};
  box.cell_m = 0.1;
  box.size = {6, 5, 4};
  std::size_t count = 0;
  for (int k = 0; k < 6 * 5 * 4; ++k) {
    box.occupied.push_back(random.chance(0.5) ? 1 : 0);
    count += box.occupied.back();
  }
  sim::TriangleMesh mesh;
  append_exposed_faces(box, mesh);
  double volume = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    const glm::dvec3 a(mesh.positions_m[t.x]);
    const glm::dvec3 b(mesh.positions_m[t.y]);
    const glm::dvec3 c(mesh.positions_m[t.z]);
    volume += (a.x * (b.y * c.z - b.z * c.y) - a.y * (b.x * c.z - b.z * c.x) +
               a.z * (b.x * c.y - b.y * c.x)) /
              6.0;
  }
  EXPECT_NEAR(volume, 0.001 * static_cast<double>(count), 1e-5);
}

}  // namespace
}  // namespace segsim::worlds
