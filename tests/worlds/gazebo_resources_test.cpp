/// @file
/// What worlds of others have in them: files in other folders, files that are missing, names
/// that repeat, models inside models, materials of every kind, numbers that are none.

#include <algorithm>
#include <cstdlib>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "tests/error_message.h"
#include "tests/worlds/mesh_fixtures.h"
#include "worlds/mesh/gazebo/gazebo_import.h"

namespace segsim::worlds {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

std::string box_visual(const std::string& material = "", const std::string& name = "v") {
  return "<visual name='" + name + "'><geometry><box><size>1 1 1</size></box></geometry>" +
         material + "</visual>";
}

std::string model(const std::string& name, const std::string& content) {
  return "<model name='" + name + "'><static>1</static>" + content + "</model>";
}

std::string box_model(const std::string& name, const std::string& pose = "0 0 0 0 0 0",
                      const std::string& material = "") {
  return model(name,
               "<pose>" + pose + "</pose><link name='l'>" + box_visual(material) + "</link>");
}

std::string mesh_visual(const std::string& uri, const std::string& material = "") {
  return "<visual name='v'><geometry><mesh><uri>" + uri + "</uri></mesh></geometry>" +
         material + "</visual>";
}

std::string mesh_model(const std::string& name, const std::string& uri,
                       const std::string& material = "") {
  return model(name, "<link name='l'>" + mesh_visual(uri, material) + "</link>");
}

std::string include(const std::string& uri, const std::string& more = "") {
  return "<include><uri>" + uri + "</uri>" + more + "</include>";
}

class GazeboResources : public ::testing::Test {
 protected:
  void SetUp() override { options_.ceiling.kind = CeilingKind::kNone; }

  /// A model folder with the content of a <model>.
  void write_model(const std::string& folder, const std::string& content) {
    folder_.write(folder + "/model.config",
                  "<model><name>m</name><sdf version='1.6'>model.sdf</sdf></model>");
    folder_.write(folder + "/model.sdf", "<sdf version='1.6'>" + content + "</sdf>");
  }
  void write_triangle(const std::string& file) {
    folder_.write(file, collada_triangle("0.01", "1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1"));
  }
  sim::MeshScene load(const std::string& content) {
    folder_.write("place/worlds/test.world",
                  "<sdf version='1.6'><world name='w'>" + content + "</world></sdf>");
    return load_gazebo_world(folder_ / "place/worlds/test.world", options_);
  }
  std::string error_of(const std::string& content) {
    return tests::input_error_of([&] { (void)load(content); });
  }
  static std::vector<std::string> names(const sim::MeshScene& scene) {
    std::vector<std::string> names;
    for (const core::SceneInstance& instance : scene.instances) names.push_back(instance.name);
    return names;
  }
  static std::string class_of(const sim::MeshScene& scene, const sim::SubMesh& mesh) {
    return scene.classes[mesh.class_id - 1U].name;
  }
  static const sim::Material& material(const sim::MeshScene& scene, std::size_t mesh = 0) {
    return scene.materials[static_cast<std::size_t>(scene.meshes[mesh].material)];
  }

  TemporaryFolder folder_;
  GazeboImportOptions options_;
};

TEST_F(GazeboResources, EveryKindOfUriIsFound) {
  write_triangle("place/models/chair/meshes/a.dae");
  write_triangle("place/media/meshes/b.dae");
  write_triangle("place/worlds/c.dae");
  write_triangle("place/extra_models/desk/d.dae");
  const sim::MeshScene scene = load(
      mesh_model("chair_a", "model://chair/meshes/a.dae") +
      mesh_model("chair_b", "model://some_package/models/chair/meshes/a.dae") +
      mesh_model("chair_c", "package://some_package/models/chair/meshes/a.dae") +
      mesh_model("chair_d", "file://media/meshes/b.dae") + mesh_model("chair_e", "c.dae") +
      mesh_model("chair_f", "file://" + (folder_ / "place/worlds/c.dae").string()) +
      mesh_model("desk_g", "model://desk/d.dae"));
  EXPECT_EQ(scene.meshes.size(), 7U);
  EXPECT_THAT(scene.warnings, IsEmpty());
}

TEST_F(GazeboResources, FoldersCanBeNamed) {
  write_triangle("elsewhere/chair/a.dae");
  const std::string content = mesh_model("chair_1", "model://chair/a.dae");
  EXPECT_THAT(error_of(content), HasSubstr("model://chair/a.dae"));
  options_.resource_paths = {folder_ / "elsewhere"};
  EXPECT_EQ(load(content).meshes.size(), 1U);
  options_.resource_paths.clear();
  for (const char* variable : {"GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH"}) {
    ::setenv(variable, ("/nowhere:" + (folder_ / "elsewhere").string()).c_str(), 1);
    EXPECT_EQ(load(content).meshes.size(), 1U) << variable;
    ::unsetenv(variable);
  }
  options_.resource_paths = {folder_ / "no such folder"};
  EXPECT_THAT(error_of(content), HasSubstr("no such folder"));
}

TEST_F(GazeboResources, SunAndGroundPlaneAreBuiltIn) {
  const sim::MeshScene scene =
      load(include("model://sun") + include("model://ground_plane") +
           box_model("chair", "3 4 0.5 0 0 0") + box_model("desk", "-3 -4 0.5 0 0 0"));
  EXPECT_THAT(scene.warnings, IsEmpty());
  ASSERT_EQ(scene.meshes.size(), 3U);
  const sim::SubMesh& ground = scene.meshes.back();
  EXPECT_EQ(class_of(scene, ground), "floor");
  glm::vec3 low(1e9F);
  glm::vec3 high(-1e9F);
  for (const glm::vec3& p : ground.positions_m) {
    low = glm::min(low, p);
    high = glm::max(high, p);
  }
  // 100 m x 100 m, cut to the boxes' plan and a metre around it.
  EXPECT_NEAR(glm::distance(low, glm::vec3(-4.5, -5.5, -0.005)), 0.0, 1e-4);
  EXPECT_NEAR(glm::distance(high, glm::vec3(4.5, 5.5, -0.005)), 0.0, 1e-4);
}

TEST_F(GazeboResources, AllMissingFilesAreListedAtOnce) {
  folder_.write("place/models/lamp/lamp.obj",
                "mtllib lamp.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  folder_.write("place/models/lamp/lamp.mtl", "newmtl a\nKd 0 0 0\nmap_Kd shade.png\n");
  const std::string message = error_of(
      include("model://unknown") + mesh_model("chair_1", "model://chair/a.dae") +
      mesh_model("chair_2", "model://chair/a.dae") + mesh_model("desk", "model://desk/b.dae") +
      mesh_model("lamp", "model://lamp/lamp.obj") +
      box_model("bed", "0 0 0 0 0 0",
                "<material><script><uri>model://bed</uri><name>Bed/Blue</name></script>"
                "</material>"));
  EXPECT_THAT(message, AllOf(HasSubstr("test.world"), HasSubstr("5 missing"),
                             HasSubstr("model model://unknown"),
                             HasSubstr("mesh model://chair/a.dae (chair_1 and 1 more)"),
                             HasSubstr("mesh model://desk/b.dae (desk)"),
                             HasSubstr("texture shade.png (lamp.obj)")));
  EXPECT_THAT(message, AllOf(HasSubstr("material Bed/Blue (bed)"),
                             HasSubstr("--resource-path"), HasSubstr("--on-missing")));
  EXPECT_THAT(message, Not(HasSubstr("\n")));
}

TEST_F(GazeboResources, MissingMeshesAreSkippedOrReplaced) {
  const std::string content =
      model("desk", "<link name='l'><pose>0 0 1 0 0 0</pose>" +
                        mesh_visual("model://desk/b.dae") +
                        "<collision name='c'><geometry><box><size>1 2 0.5</size></box>"
                        "</geometry></collision></link>") +
      box_model("chair");
  options_.on_missing = OnMissing::kSkip;
  const sim::MeshScene skipped = load(content);
  EXPECT_THAT(names(skipped), ElementsAre("chair"));
  EXPECT_THAT(skipped.warnings, ElementsAre(HasSubstr("model://desk/b.dae")));

  options_.on_missing = OnMissing::kCollision;
  const sim::MeshScene replaced = load(content);
  ASSERT_THAT(names(replaced), ElementsAre("desk", "chair"));
  EXPECT_EQ(replaced.instances[0].box_min_m, glm::dvec3(-0.5, -1, 0.75));
  EXPECT_THAT(replaced.warnings, ElementsAre(HasSubstr("model://desk/b.dae")));

  options_.on_missing = OnMissing::kSkip;
  EXPECT_THAT(error_of(mesh_model("desk", "model://desk/b.dae")),
              AllOf(HasSubstr("nothing but missing files"), HasSubstr("model://desk/b.dae")))
      << "a world of nothing else is no world";
}

TEST_F(GazeboResources, EqualNamesAreNumbered) {
  write_model("place/models/chair", box_model("chair"));
  const sim::MeshScene scene =
      load(include("model://chair") + include("model://chair", "<pose>2 0 0 0 0 0</pose>") +
           box_model("chair_0", "4 0 0 0 0 0") +
           include("model://chair", "<pose>6 0 0 0 0 0</pose>") +
           model("desk", "<link name='l'>" + box_visual() + box_visual() + "</link>"));
  // chair_0 is somebody else's name, as it is in Gazebo. Includes come before models.
  EXPECT_THAT(names(scene), ::testing::UnorderedElementsAre("chair", "chair_1", "chair_2",
                                                            "chair_0", "desk"));
  EXPECT_EQ(scene.meshes.size(), 6U) << "two visuals of one name, too";
}

TEST_F(GazeboResources, ModelsAreWhereTheStateHasPutThem) {
  const sim::MeshScene scene =
      load(box_model("chair", "1 0 0 0 0 0") + box_model("desk", "2 0 0 0 0 0") +
           "<state world_name='w'><model name='chair'><pose>10 0 0 0 0 0</pose>"
           "<scale>1 1 1</scale></model></state>");
  ASSERT_THAT(names(scene), ElementsAre("chair", "desk"));
  EXPECT_EQ(scene.instances[0].box_min_m.x, 9.5);
  EXPECT_EQ(scene.instances[1].box_min_m.x, 1.5);
}

TEST_F(GazeboResources, ModelsOutOfTheWorldAreLeftOut) {
  const sim::MeshScene scene =
      load(box_model("chair") + box_model("desk", "1 0 -7.5e8 0 0 0"));
  EXPECT_THAT(names(scene), ElementsAre("chair"));
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("desk is left out")));
}

TEST_F(GazeboResources, NestedModelsHaveLabelsOfTheirOwn) {
  write_model("place/models/office_chair", box_model("office_chair"));
  const std::string chair = include("model://office_chair");
  const sim::MeshScene scene =
      load(model("Qwfp_1", chair + box_model("desk") + box_model("part")) +
           model("sofa", "<link name='l'>" + box_visual() + "</link>" + box_model("leg")) +
           model("ChairA_7", chair));
  EXPECT_THAT(names(scene), ElementsAre("Qwfp_1::office_chair", "Qwfp_1::desk", "Qwfp_1::part",
                                        "sofa", "ChairA_7"));
  EXPECT_EQ(class_of(scene, scene.meshes[0]), "chair");
  EXPECT_EQ(class_of(scene, scene.meshes[1]), "desk");
  EXPECT_EQ(class_of(scene, scene.meshes[2]), "unknown");
  EXPECT_EQ(class_of(scene, scene.meshes[4]), "couch") << "a leg is part of the sofa";
}

TEST_F(GazeboResources, PartsOfABuildingSayWhatTheyAre) {
  const sim::MeshScene scene =
      load(model("PublicBathroomA",
                 "<link name='l'>" + box_visual("", "shell") + box_visual("", "floor_1_2") +
                     "</link><link name='door'>" + box_visual() + "</link>") +
           model("fridge", "<link name='door'>" + box_visual() + "</link>"));
  ASSERT_EQ(scene.meshes.size(), 4U);
  EXPECT_EQ(class_of(scene, scene.meshes[0]), "wall");
  EXPECT_EQ(class_of(scene, scene.meshes[1]), "floor");
  EXPECT_EQ(class_of(scene, scene.meshes[2]), "door");
  EXPECT_EQ(class_of(scene, scene.meshes[3]), "refrigerator") << "its door is part of it";
}

TEST_F(GazeboResources, ClassesCanBeCorrected) {
  options_.corrected_class = [](const std::string& words) -> std::optional<std::string> {
    if (words == "qwfp") return "couch";
    if (words == "office chair") return "unknown";
    return std::nullopt;
  };
  const sim::MeshScene scene = load(box_model("Qwfp_3") + box_model("OfficeChair_1") +
                                    box_model("OfficeChair_2") + box_model("desk"));
  ASSERT_EQ(scene.class_guesses.size(), 3U);
  const auto guess = [&](std::size_t i) {
    const sim::ClassGuess& made = scene.class_guesses[i];
    return made.words + " is " + scene.classes[made.class_id - 1U].name + " " +
           std::to_string(made.count);
  };
  EXPECT_EQ(guess(0), "qwfp is couch 1");
  EXPECT_EQ(guess(1), "office chair is unknown 2");
  EXPECT_EQ(guess(2), "desk is desk 1");
}

TEST_F(GazeboResources, GazebosOwnMaterialsHaveTheirColours) {
  const auto script = [](const std::string& name) {
    return "<material><script><uri>file://media/materials/scripts/gazebo.material</"
           "uri><name>" +
           name + "</name></script><ambient>1 1 1 1</ambient></material>";
  };
  write_triangle("place/models/chair/a.dae");
  const sim::MeshScene scene =
      load(box_model("chair", "0 0 0 0 0 0", script("Gazebo/Red")) +
           mesh_model("chair_2", "model://chair/a.dae", script("Gazebo/Wood")) +
           box_model("desk", "0 0 0 0 0 0", script("Gazebo/Qwfp")));
  EXPECT_EQ(material(scene, 0).albedo, glm::vec3(1, 0, 0));
  EXPECT_GT(material(scene, 1).albedo.r, 2.0F * material(scene, 1).albedo.b) << "brown";
  EXPECT_GT(material(scene, 2).albedo.r, 0.3F) << "an unknown name is no reason to be black";
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("material Gazebo/Qwfp (desk)")));
}

TEST_F(GazeboResources, ScriptsGiveColoursAndTextures) {
  folder_.write("place/models/chair/materials/scripts/a.material", R"(
    // material Chair/Comment { }
    material Chair/Base {
      technique { pass { ambient 0 0 0 diffuse 0 0 1 1 /* not 1 1 1 */
                         texture_unit { texture four.png
                                        filtering trilinear } } }
      technique { pass { diffuse 0 1 0
        } }
    }
    material Chair/Plain : Chair/Base
    {
      technique
      {
        pass
        {
          diffuse 1 0 0 1
          texture_unit
          {
            texture none.png
          }
        }
      }
    }
    material Chair/Green
    {
      technique
      {
        pass
        {
          diffuse 0 1 0
          texture_unit
          {
            texture four.png
          }
        }
      }
    })");
  std::filesystem::create_directories(folder_ / "place/models/chair/materials/textures");
  write_png_2x2(folder_ / "place/models/chair/materials/textures/four.png");
  const auto script = [](const std::string& name) {
    return "<material><script><uri>model://chair/materials/scripts</uri>"
           "<uri>model://chair/materials/textures</uri><name>" +
           name + "</name></script></material>";
  };
  const sim::MeshScene scene =
      load(box_model("chair", "0 0 0 0 0 0", script("Chair/Green")) +
           box_model("chair_b", "0 0 0 0 0 0", script("Chair/Plain")));
  EXPECT_EQ(material(scene, 0).albedo, glm::vec3(0, 1, 0));
  ASSERT_EQ(material(scene, 0).texture, 0);
  EXPECT_EQ(scene.textures[0](0, 0), (core::Rgb8{255, 0, 0}));
  EXPECT_EQ(material(scene, 1).albedo, glm::vec3(1, 0, 0));
  EXPECT_EQ(material(scene, 1).texture, -1);
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("texture none.png (Chair/Plain)")));
}

TEST_F(GazeboResources, ColoursAndPbrTexturesCoverTheMeshsOwn) {
  write_triangle("place/models/chair/a.dae");
  write_png_2x2(folder_ / "place/models/chair/four.png");
  const auto pbr = [](const std::string& file) {
    return "<material><diffuse>0 1 0 1</diffuse><pbr><metal><albedo_map>" + file +
           "</albedo_map></metal></pbr></material>";
  };
  const std::string uri = "model://chair/a.dae";
  const sim::MeshScene scene =
      load(mesh_model("chair_a", uri) +
           mesh_model("chair_b", uri, "<material><diffuse>1 0 0 1</diffuse></material>") +
           mesh_model("chair_c", uri, pbr("model://chair/four.png")) +
           mesh_model("chair_d", uri, "<material><specular>1 1 1 1</specular></material>"));
  EXPECT_GT(material(scene, 0).albedo.g, 0.1F) << "the mesh's own";
  EXPECT_EQ(material(scene, 1).albedo, glm::vec3(1, 0, 0));
  EXPECT_EQ(material(scene, 2).albedo, glm::vec3(0, 1, 0));
  EXPECT_EQ(material(scene, 2).texture, 0);
  EXPECT_EQ(material(scene, 3).albedo, material(scene, 0).albedo) << "a gloss is no colour";
}

TEST_F(GazeboResources, NumbersThatAreNoneAreMended) {
  std::string text = collada_triangle("0.01", "1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1");
  const std::string numbers = "0 0 0 100 0 0 0 100 0";
  text.replace(text.find(numbers), numbers.size(), "-1.#IND 0 nan 100,0 0 0e 0 100 0");
  folder_.write("place/models/chair/a.dae", text);
  folder_.write("place/models/desk/b.obj",
                "v 0 0 inf\nv 1,5 0 0\nv 0 1 0\nvn 0 0 1.#QNAN\nf 1 2 3\n");
  const sim::MeshScene scene = load(mesh_model("chair", "model://chair/a.dae") +
                                    mesh_model("desk", "model://desk/b.obj"));
  ASSERT_EQ(scene.instances.size(), 2U);
  EXPECT_NEAR(glm::distance(scene.instances[0].box_max_m, glm::dvec3(1, 1, 0)), 0, 1e-6);
  EXPECT_NEAR(glm::distance(scene.instances[1].box_max_m, glm::dvec3(1.5, 1, 0)), 0, 1e-6);
  EXPECT_THAT(
      scene.warnings,
      ElementsAre(AllOf(HasSubstr("mended 4 numbers of a.dae"), HasSubstr("-1.#IND")),
                  AllOf(HasSubstr("mended 3 numbers of b.obj"), HasSubstr("\"inf\""))));
}

TEST_F(GazeboResources, ABlankBeforeAColourIsReadWithoutAWord) {
  std::string text = collada_triangle("0.01", "1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1");
  text.insert(text.find("<library_geometries>"),
              "<library_effects><effect id='e'><profile_COMMON><technique sid='t'><lambert>"
              "<diffuse><color> 1 0 0 1</color></diffuse></lambert></technique>"
              "</profile_COMMON></effect></library_effects><library_materials>"
              "<material id='m'><instance_effect url='#e'/></material></library_materials>");
  folder_.write("place/models/chair/a.dae", text);
  const sim::MeshScene scene = load(mesh_model("chair", "model://chair/a.dae"));
  EXPECT_EQ(scene.meshes.size(), 1U);
  EXPECT_THAT(scene.warnings, IsEmpty());
}

TEST_F(GazeboResources, ACeilingIsMadeAtTheWallsHeightWhereNoneIs) {
  options_.ceiling.kind = CeilingKind::kWalls;
  const auto wall = [](const std::string& pose, const std::string& size) {
    return model("wall", "<pose>" + pose +
                             "</pose><link name='l'><visual name='v'><geometry>"
                             "<box><size>" +
                             size + "</size></box></geometry></visual></link>");
  };
  // A room of 4 m x 4 m with walls of 2.6 m, and a yard to its right behind an open wall.
  const std::string walls =
      wall("-2 0 1.3 0 0 0", "0.1 4 2.6") + wall("2 0 1.3 0 0 0", "0.1 4 2.6") +
      wall("0 -2 1.3 0 0 0", "4 0.1 2.6") + wall("0 2 1.3 0 0 0", "4 0.1 2.6") +
      wall("4 -2 1.3 0 0 0", "4 0.1 2.6");
  const sim::MeshScene scene = load(walls);
  double area_m2 = 0.0;
  for (const sim::SubMesh& mesh : scene.meshes) {
    if (class_of(scene, mesh) != "ceiling") continue;
    glm::vec3 low(1e9F);
    glm::vec3 high(-1e9F);
    for (const glm::vec3& p : mesh.positions_m) {
      low = glm::min(low, p);
      high = glm::max(high, p);
    }
    EXPECT_NEAR(low.z, 2.6F, 1e-3F);
    area_m2 += static_cast<double>((high.x - low.x) * (high.y - low.y));
  }
  EXPECT_NEAR(area_m2, 17.5, 2.0) << "the room and its walls, not the yard";
  EXPECT_THAT(scene.source, HasSubstr("ceiling made at 2.6 m"));
  ASSERT_FALSE(scene.lights.empty());
  EXPECT_NEAR(scene.lights[0].position_m.z, 2.6F - 0.45F, 1e-3F);

  const std::string lid = model("ceiling",
                                "<pose>1 0 2.65 0 0 0</pose><link name='l'><visual "
                                "name='v'><geometry><box><size>8 4 0.1</size></box>"
                                "</geometry></visual></link>");
  EXPECT_EQ(load(walls + lid).meshes.size(), 6U) << "one is there";
}

}  // namespace
}  // namespace segsim::worlds
