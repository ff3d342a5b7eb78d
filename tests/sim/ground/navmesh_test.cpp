#include "sim/ground/navmesh.h"

#include <cmath>
#include <fstream>
#include <limits>

#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "tests/box_mesh.h"
#include "tests/sim/rooms.h"

namespace segsim::sim {
namespace {

/// Made for y up, as Recast has it, and turned to z up: (x, y, z) there is (x, z, -y) here.
TriangleMesh make_fixture() {
  TriangleMesh mesh;
  append_floor(mesh, -5, -5, 5, 5);
  append_box(mesh, {-0.1F, -2.0F, 0.0F}, {0.1F, 5.0F, 2.0F});
  return mesh;
}

NavmeshSettings settings_of(double radius_m, double cell_height_m) {
  NavmeshSettings settings;
  settings.agent_height_m = 0.88;
  settings.agent_radius_m = radius_m;
  settings.cell_height_m = cell_height_m;
  settings.max_climb_m = 0.2;
  return settings;
}

struct Expected {
  double radius_m, recast_m, true_m;
};

class NavmeshFixture : public testing::TestWithParam<Expected> {};

TEST_P(NavmeshFixture, PathLengthIsThatOfTheNotes) {
  const auto [radius_m, recast_m, true_m] = GetParam();
  for (const double cell_height_m : {0.2, 0.05}) {
    const Navmesh navmesh =
        Navmesh::build(make_fixture(), settings_of(radius_m, cell_height_m));
    const auto path = navmesh.find_path({-3, 3, 0}, {3, 3, 0});
    ASSERT_TRUE(path.has_value());
    EXPECT_NEAR(path->length_m, recast_m, 0.01 * recast_m);
    EXPECT_NEAR(path->length_m, true_m, 0.015 * true_m);
    EXPECT_GE(path->corners_m.size(), 3U);
  }
}

INSTANTIATE_TEST_SUITE_P(Radii, NavmeshFixture,
                         testing::Values(Expected{0.10, 12.0506, 11.9710},
                                         Expected{0.18, 12.2756, 12.1422},
                                         Expected{0.33, 12.5723, 12.4690}));

TEST(Navmesh, IslandsAreSortedByArea) {
  TriangleMesh mesh = make_room(6.0F, 4.0F);
  append_box(mesh, {1.9F, 0.0F, 0.0F}, {2.1F, 4.0F, 2.0F});
  NavmeshSettings settings = settings_of(0.2, 0.05);
  settings.agent_height_m = 1.0;
  const Navmesh navmesh = Navmesh::build(mesh, settings);
  const auto& areas = navmesh.island_areas_m2();
  ASSERT_GE(areas.size(), 2U);
  EXPECT_NEAR(areas[0], (3.9 - 0.4) * (4.0 - 0.4), 1.0);
  const auto right = navmesh.nearest({4.0, 2.0, 0.0});
  const auto left = navmesh.nearest({1.0, 2.0, 0.0});
  ASSERT_TRUE(right && left);
  EXPECT_EQ(right->island, 0);
  EXPECT_NE(left->island, 0);
  EXPECT_FALSE(navmesh.find_path({1, 2, 0}, {4, 2, 0}).has_value());
  EXPECT_FALSE(navmesh.nearest({20.0, 2.0, 0.0}).has_value());
}

TEST(Navmesh, SamplesOneIslandByArea) {
  // An L: the long arm holds three quarters of the area.
  TriangleMesh mesh;
  append_floor(mesh, 0, 0, 6, 2);
  append_floor(mesh, 0, 2, 2, 4);
  NavmeshSettings settings = settings_of(0.05, 0.05);
  const Navmesh navmesh = Navmesh::build(mesh, settings);
  core::RandomStream random(7, "samples");
  int upper = 0;
  constexpr int kCount = 4000;
  for (int k = 0; k < kCount; ++k) {
    const glm::dvec3 p = navmesh.random_point(random);
    const auto back = navmesh.nearest(p, 0.05);
    ASSERT_TRUE(back.has_value());
    ASSERT_EQ(back->island, 0);
    ASSERT_TRUE(p.x > 0 && p.y > 0 && p.x < 6 && p.y < 4 && (p.x < 2.1 || p.y < 2.1));
    EXPECT_NEAR(p.z, 0.0, 0.11);
    upper += p.y > 2.0 ? 1 : 0;
  }
  // Share of the eroded area, 1.8 x 1.9 of that plus 5.8 x 1.9 about; 4 sigma is 0.03.
  EXPECT_NEAR(static_cast<double>(upper) / kCount, 0.24, 0.035);
}

TEST(Navmesh, FileRoundTripAnswersAlike) {
  const auto file = std::filesystem::path(testing::TempDir()) / "segsim_navmesh_test.bin";
  const Navmesh built = Navmesh::build(make_two_rooms(), settings_of(0.2, 0.05));
  built.save(file);
  const Navmesh loaded = Navmesh::load(file);
  EXPECT_EQ(loaded.settings(), built.settings());
  EXPECT_EQ(loaded.polygon_count(), built.polygon_count());
  EXPECT_EQ(loaded.island_areas_m2(), built.island_areas_m2());
  const auto a = built.find_path({1, 1, 0}, {5, 1, 0});
  const auto b = loaded.find_path({1, 1, 0}, {5, 1, 0});
  ASSERT_TRUE(a && b);
  EXPECT_DOUBLE_EQ(a->length_m, b->length_m);
  EXPECT_GT(a->length_m, 4.0);

  const std::string good = core::read_file(file);
  const auto refused = [&](const std::string& text) {
    std::ofstream(file, std::ios::binary) << text;
    EXPECT_THROW((void)Navmesh::load(file), core::InputError) << text.size();
  };
  refused(good.substr(0, good.size() - 1));
  refused(good.substr(0, 10));
  refused("");
  std::string other = good;
  other[0] = 'x';
  refused(other);
  other = good;
  other[8] = 9;  // Version.
  refused(other);
  other = good;
  other[8 + 4 + 12 * 8 + 8] = 'x';  // Detour's own magic.
  refused(other);
  std::filesystem::remove(file);
}

/// Detour follows indices without a look at them: whatever byte of the file is another one,
/// the mesh is refused or can be asked without harm. Sanitizers would see more than a crash.
TEST(Navmesh, NoDamagedByteLeadsDetourAstray) {
  const auto file = std::filesystem::path(testing::TempDir()) / "segsim_navmesh_damaged.bin";
  Navmesh::build(make_two_rooms(), settings_of(0.2, 0.05)).save(file);
  const std::string good = core::read_file(file);
  constexpr std::size_t kBlock = 8 + 4 + 12 * 8 + 8;
  int refused = 0;
  for (std::size_t at = kBlock; at < good.size(); ++at) {
    for (const char value : {'\x00', '\x7f', '\xff'}) {
      if (good[at] == value) continue;
      std::string damaged = good;
      damaged[at] = value;
      std::ofstream(file, std::ios::binary) << damaged;
      try {
        const Navmesh navmesh = Navmesh::load(file);
        core::RandomStream random(1, "damaged");
        for (int k = 0; k < 3; ++k) {
          static_cast<void>(navmesh.nearest({1.0 + k, 1.0, 0.0}, 0.5));
        }
        static_cast<void>(navmesh.find_path({1, 1, 0}, {5, 1, 0}));
        static_cast<void>(navmesh.random_point(random, 0));
      } catch (const core::InputError&) {
        ++refused;
      }
    }
  }
  EXPECT_GT(refused, static_cast<int>(good.size() - kBlock) / 2);
  std::filesystem::remove(file);
}

TEST(Navmesh, PlacesBeyondAnyWorldAreOffTheMesh) {
  const Navmesh navmesh = Navmesh::build(make_two_rooms(), settings_of(0.2, 0.05));
  for (const double far : {1e20, 1e308, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_FALSE(navmesh.nearest({far, 1, 0}, 0.5).has_value());
    EXPECT_FALSE(navmesh.find_path({1, 1, 0}, {far, 1, 0}).has_value());
  }
}

TEST(Navmesh, GroundBeyondMemoryIsRefused) {
  TriangleMesh mesh = make_two_rooms();
  mesh.positions_m.emplace_back(1e6F, 1e6F, 0.0F);
  EXPECT_THROW((void)Navmesh::build(mesh, settings_of(0.2, 0.05)), core::InputError);
}

TEST(Navmesh, NoRoomIsAnError) {
  TriangleMesh mesh;
  EXPECT_THROW((void)Navmesh::build(mesh, {}), core::InputError);
  append_floor(mesh, 0, 0, 0.3F, 0.3F);
  EXPECT_THROW((void)Navmesh::build(mesh, {}), core::InputError);
}

}  // namespace
}  // namespace segsim::sim
