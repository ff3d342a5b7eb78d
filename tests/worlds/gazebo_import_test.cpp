#include "worlds/mesh/gazebo/gazebo_import.h"

#include <algorithm>
#include <cstdlib>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/error.h"
#include "tests/worlds/mesh_fixtures.h"

namespace segsim::worlds {
namespace {

using ::testing::HasSubstr;

const char* const kChairModel =
    R"(<sdf version="1.6"><model name="chair_model"><static>1</static>
  <link name="link"><pose>0 0 1 0 0 0</pose><visual name="v"><geometry><mesh>
  <uri>model://chair_model/meshes/tri.dae</uri><scale>2 2 2</scale></mesh></geometry></visual></link>
  </model></sdf>)";
const char* const kConfig =
    R"(<model><name>m</name><sdf version="1.6">model.sdf</sdf></model>)";

std::string world(const std::string& content) {
  return "<sdf version='1.6'><world name='w'>" + content + "</world></sdf>";
}

class GazeboImport : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_.write("models/chair_model/model.sdf", kChairModel);
    folder_.write("models/chair_model/model.config", kConfig);
    folder_.write("models/chair_model/meshes/tri.dae",
                  collada_triangle("0.01", "1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1"));
  }
  /// Without a ceiling of ours, unless the options say otherwise.
  static GazeboImportOptions open_top() {
    GazeboImportOptions options;
    options.ceiling.kind = CeilingKind::kNone;
    return options;
  }
  sim::MeshScene load(const std::string& text,
                      const GazeboImportOptions& options = open_top()) {
    folder_.write("worlds/test.world", text);
    return load_gazebo_world(folder_.path() / "worlds" / "test.world", options);
  }
  TemporaryFolder folder_;
};

TEST_F(GazeboImport, IncludesNestedPosesAndScales) {
  const sim::MeshScene scene = load(world(R"(
    <model name='ChairA_01_001'><static>true</static>
      <include><uri>model://chair_model</uri></include>
      <pose frame=''>10 20 0 0 0 1.5707963267948966</pose></model>)"));
  ASSERT_EQ(scene.instances.size(), 1U);
  EXPECT_EQ(scene.instances[0].name, "ChairA_01_001");
  EXPECT_EQ(scene.classes[0].name, "chair");
  // The triangle (0,0,0), (1,0,0), (0,1,0) [m], scaled by 2, turned by 90 degrees, link 1 m
  // up.
  EXPECT_NEAR(glm::distance(scene.instances[0].box_min_m, glm::dvec3(8, 20, 1)), 0.0, 1e-5);
  EXPECT_NEAR(glm::distance(scene.instances[0].box_max_m, glm::dvec3(10, 22, 1)), 0.0, 1e-5);
  EXPECT_TRUE(scene.warnings.empty());
  EXPECT_FALSE(scene.lights.empty());
}

TEST_F(GazeboImport, PrimitivesFaceOutwardsAndHaveTheirSize) {
  const auto visual = [](const std::string& name, const std::string& geometry) {
    return "<model name='" + name +
           "'><static>1</static><pose>5 0 1 0 0 0</pose><link name='l'>" +
           "<visual name='v'><geometry>" + geometry +
           "</geometry><material><diffuse>0 1 0 "
           "1</diffuse></material></visual></link></model>";
  };
  const sim::MeshScene scene = load(
      world(visual("Ball_1", "<sphere><radius>0.5</radius></sphere>") +
            visual("Bed_1", "<box><size>1 2 3</size></box>") +
            visual("Vase_1", "<cylinder><radius>0.2</radius><length>2</length></cylinder>") +
            visual("Table_1", "<plane><normal>0 0 1</normal><size>2 4</size></plane>")));
  ASSERT_EQ(scene.meshes.size(), 4U);
  const glm::dvec3 half[] = {{0.5, 0.5, 0.5}, {0.5, 1, 1.5}, {0.2, 0.2, 1}, {1, 2, 0}};
  for (std::size_t i = 0; i < 4; ++i) {
    const sim::SubMesh& mesh = scene.meshes[i];
    const glm::dvec3 centre(5, 0, 1);
    EXPECT_NEAR(glm::distance(scene.instances[i].box_min_m, centre - half[i]), 0, 1e-5) << i;
    EXPECT_NEAR(glm::distance(scene.instances[i].box_max_m, centre + half[i]), 0, 1e-5) << i;
    const auto material = static_cast<std::size_t>(mesh.material);
    EXPECT_EQ(scene.materials[material].albedo, glm::vec3(0, 1, 0));
    // Signed volume by the divergence theorem: positive when all faces look outwards.
    double volume = 0;
    for (const glm::uvec3& t : mesh.triangles) {
      const glm::dvec3 a = glm::dvec3(mesh.positions_m[t.x]) - centre;
      const glm::dvec3 b = glm::dvec3(mesh.positions_m[t.y]) - centre;
      const glm::dvec3 c = glm::dvec3(mesh.positions_m[t.z]) - centre;
      volume += glm::dot(a, glm::cross(b, c)) / 6;
      EXPECT_GT(glm::dot(glm::cross(b - a, c - a), glm::dvec3(mesh.normals[t.x])), 0.0);
    }
    const double expected[] = {4.0 / 3.0 * 3.14159265 * 0.125, 6.0, 3.14159265 * 0.04 * 2,
                               0.0};
    EXPECT_NEAR(volume, expected[i], 0.015 * expected[i] + 1e-6) << i;
  }
}

TEST_F(GazeboImport, ACeilingModelCanBeAdded) {
  folder_.write("models/lid/model.sdf", R"(<sdf version="1.6"><model name="RoomCeiling">
    <static>1</static><link name="l"><visual name="v"><geometry><box><size>2 2 0.1</size></box>
    </geometry></visual></link></model></sdf>)");
  folder_.write("models/lid/model.config", kConfig);
  GazeboImportOptions options;
  options.ceiling = {CeilingKind::kModel, 3.0, "lid"};
  const sim::MeshScene scene = load(world(""), options);
  ASSERT_EQ(scene.meshes.size(), 1U);
  EXPECT_EQ(scene.classes[0].name, "ceiling");
  EXPECT_NEAR(scene.meshes[0].positions_m[0].z, 3.0, 0.051);
  options.ceiling.model = "none";
  EXPECT_THROW((void)load(world(""), options), core::InputError);
}

TEST_F(GazeboImport, AnInvalidInertiaIsAWarning) {
  const sim::MeshScene scene =
      load(world(R"(<model name='Bed_1'><link name='l'><inertial><mass>1</mass>
    <inertia><ixx>1</ixx><iyy>1</iyy><izz>9</izz></inertia></inertial><visual name='v'><geometry>
    <box><size>1 1 1</size></box></geometry></visual></link></model>)"));
  EXPECT_EQ(scene.triangle_count(), 12U);
  ASSERT_FALSE(scene.warnings.empty());
  EXPECT_THAT(scene.warnings[0], HasSubstr("inertia"));
}

TEST_F(GazeboImport, BadWorldsAreInputErrors) {
  EXPECT_THROW((void)load_gazebo_world(folder_.path() / "none.world"), core::InputError);
  EXPECT_THROW((void)load("<sdf version='1.6'></sdf>"), core::InputError);
  EXPECT_THROW((void)load("no xml"), core::InputError);
  EXPECT_THROW((void)load(world("<include><uri>model://unknown</uri></include>")),
               core::InputError);
  std::filesystem::remove(folder_.path() / "models/chair_model/meshes/tri.dae");
  try {
    (void)load(world("<include><uri>model://chair_model</uri></include>"));
    FAIL() << "a missing mesh must not be accepted";
  } catch (const core::InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("tri.dae"));
  }
}

TEST(SmallHouse, IsReadWhole) {
  const char* data = std::getenv("SEGSIM_DATA");
  if (data == nullptr) GTEST_SKIP() << "SEGSIM_DATA does not name the folder with small_house";
  const std::filesystem::path folder = std::filesystem::path(data) / "small_house";
  GazeboImportOptions options;
  options.ceiling.kind = CeilingKind::kNone;
  const sim::MeshScene scene =
      load_gazebo_world(folder / "worlds" / "small_house.world", options);
  // 145,844 triangles in meshes and two balls of 2 * 48 * 23.
  EXPECT_EQ(scene.triangle_count(), 145844U + 2U * 2208U);
  // 87 models, of which walls (2), floor and carpets (2) are stuff.
  EXPECT_EQ(scene.instances.size(), 87U - 5U);
  const auto count = [&](const std::string& name) {
    return std::count_if(scene.instances.begin(), scene.instances.end(),
                         [&](const auto& instance) {
                           return scene.classes[instance.class_id - 1U].name == name;
                         });
  };
  EXPECT_EQ(count("bed"), 1);
  EXPECT_EQ(count("couch"), 1);
  EXPECT_EQ(count("chair"), 8);
  EXPECT_EQ(count("tv"), 2);
  EXPECT_EQ(count("refrigerator"), 1);
  EXPECT_EQ(count("unknown"), 0);
  glm::vec3 low(1e9F);
  glm::vec3 high(-1e9F);
  for (const sim::SubMesh& mesh : scene.meshes) {
    for (const glm::vec3& p : mesh.positions_m) {
      low = glm::vec3(std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z));
      high = glm::vec3(std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z));
    }
  }
  EXPECT_NEAR(high.x - low.x, 19.0F, 0.1F);
  EXPECT_NEAR(high.y - low.y, 11.4F, 0.1F);
  const auto missing = std::count_if(
      scene.warnings.begin(), scene.warnings.end(),
      [](const std::string& warning) { return warning.starts_with("missing texture"); });
  EXPECT_EQ(missing, 2) << "the carpet's, which two models share, and a portrait's";
}

}  // namespace
}  // namespace segsim::worlds
