/// @file
/// Six Gazebo worlds as their authors publish them, none of them made for this program.

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "worlds/mesh/gazebo/gazebo_import.h"

namespace segsim::worlds {
namespace {

struct SharedWorld {
  std::string file;
  OnMissing on_missing = OnMissing::kError;
  std::size_t least_instances = 0, least_triangles = 0;
  std::map<std::string, int> counts;  ///< Instances of a class.
  std::vector<std::string> black;     ///< Models that are black on purpose.
};

const std::vector<SharedWorld>& shared_worlds() {
  static const std::vector<SharedWorld> worlds{
      {"small_warehouse/worlds/no_roof_small_warehouse.world",
       OnMissing::kError,
       20,
       13000,
       {{"shelf", 7}, {"bucket", 3}, {"pallet jack", 1}, {"trash bin", 1}, {"unknown", 0}},
       {}},
      {"centro_piaggio/world/cp_real_furniture.world",
       OnMissing::kError,
       115,
       600000,
       {{"chair", 44}, {"desk", 14}, {"bookshelf", 17}, {"toilet", 2}, {"unknown", 0}},
       {"trash"}},
      {"volta_office/worlds/office.world",
       OnMissing::kCollision,
       100,
       400000,
       {{"chair", 33}, {"couch", 2}, {"refrigerator", 1}, {"potted plant", 6}, {"unknown", 0}},
       {"office_chair"}},
      {"pal_home/worlds/home.world",
       OnMissing::kCollision,
       38,
       10000,
       {{"bookshelf", 6}, {"cabinet", 8}, {"chair", 5}, {"couch", 1}, {"unknown", 0}},
       {"tv"}},
      {"servicesim/servicesim_competition/worlds/example.world",
       OnMissing::kError,
       250,
       200000,
       {{"bathtub", 0}, {"computer", 17}, {"couch", 3}, {"refrigerator", 6}, {"tv", 42}},
       {}},
      {"hospital/worlds/hospital/worlds/hospital.world",
       OnMissing::kError,
       165,
       300000,
       {{"bed", 11}, {"toilet", 6}, {"person", 12}, {"curtain", 16}, {"unknown", 0}},
       {}},
  };
  return worlds;
}

class SharedWorlds : public ::testing::TestWithParam<SharedWorld> {};

TEST_P(SharedWorlds, AreReadWhole) {
  const char* data = std::getenv("SEGSIM_DATA");
  if (data == nullptr) GTEST_SKIP() << "SEGSIM_DATA does not name the folder with worlds";
  const std::filesystem::path file = std::filesystem::path(data) / "worlds" / GetParam().file;
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there";
  GazeboImportOptions options;
  options.on_missing = GetParam().on_missing;
  const sim::MeshScene scene = load_gazebo_world(file, options, blank_textures());
  EXPECT_GE(scene.instances.size(), GetParam().least_instances);
  EXPECT_GE(scene.triangle_count(), GetParam().least_triangles);
  std::map<std::string, int> counts;
  for (const core::SceneInstance& instance : scene.instances) {
    ++counts[scene.classes[instance.class_id - 1U].name];
  }
  for (const auto& [name, count] : GetParam().counts) EXPECT_EQ(counts[name], count) << name;
  for (const char* stuff : {"wall", "floor", "ceiling"}) {
    EXPECT_TRUE(std::any_of(scene.classes.begin(), scene.classes.end(),
                            [&](const core::SceneClass& c) { return c.name == stuff; }))
        << stuff;
  }
  for (const sim::SubMesh& mesh : scene.meshes) {
    const auto& material = scene.materials[static_cast<std::size_t>(mesh.material)];
    if (material.texture >= 0 || material.albedo != glm::vec3(0.0F)) continue;
    const std::string name = mesh.instance_id == 0
                                 ? scene.classes[mesh.class_id - 1U].name
                                 : scene.instances[mesh.instance_id - 1U].name;
    EXPECT_TRUE(std::any_of(GetParam().black.begin(), GetParam().black.end(),
                            [&](const std::string& known) { return name.starts_with(known); }))
        << name << " is black";
  }
  for (const sim::SubMesh& mesh : scene.meshes) {
    for (const glm::vec3& p : mesh.positions_m) {
      ASSERT_TRUE(std::abs(p.x) < 100.0F && std::abs(p.y) < 100.0F && std::abs(p.z) < 20.0F);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, SharedWorlds, ::testing::ValuesIn(shared_worlds()),
                         [](const auto& test) {
                           const std::string& file = test.param.file;
                           return file.substr(0, file.find('/'));
                         });

}  // namespace
}  // namespace segsim::worlds
