#include "worlds/mesh/mesh_import.h"

#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/error.h"
#include "tests/worlds/mesh_fixtures.h"

namespace segsim::worlds {
namespace {

using ::testing::HasSubstr;

class MeshImport : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
};

TEST_F(MeshImport, ReadsATexturedObjWithYUp) {
  write_png_2x2(folder_.path() / "four.png");
  folder_.write("room.mtl", "newmtl paint\nKd 0.5 0.5 0.5\nmap_Kd four.png\n");
  // A square in the plane y = 2 (up), facing up, 4 m x 6 m.
  folder_.write("room.obj",
                "mtllib room.mtl\no Chair_1\nv 0 2 0\nv 4 2 0\nv 4 2 -6\nv 0 2 -6\n"
                "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl paint\nf 1/1 2/2 3/3 4/4\n");
  const sim::MeshScene scene = load_mesh_file(folder_.path() / "room.obj");
  ASSERT_EQ(scene.meshes.size(), 1U);
  EXPECT_EQ(scene.triangle_count(), 2U);
  for (const glm::vec3& p : scene.meshes[0].positions_m) EXPECT_FLOAT_EQ(p.z, 2.0F);
  for (const glm::vec3& n : scene.meshes[0].normals) EXPECT_NEAR(n.z, 1.0F, 1e-5F);
  ASSERT_EQ(scene.instances.size(), 1U);
  EXPECT_EQ(scene.instances[0].name, "Chair_1");
  EXPECT_EQ(scene.instances[0].box_min_m, glm::dvec3(0, 0, 2));
  EXPECT_EQ(scene.instances[0].box_max_m, glm::dvec3(4, 6, 2));
  EXPECT_EQ(scene.classes[0].name, "chair");
  ASSERT_EQ(scene.textures.size(), 1U);
  EXPECT_EQ(scene.textures[0](0, 0), (core::Rgb8{255, 0, 0}))
      << "row 0 is the top of the file";
  EXPECT_EQ(scene.textures[0](1, 1), (core::Rgb8{255, 255, 255}));
  EXPECT_TRUE(scene.warnings.empty());
  EXPECT_FALSE(scene.lights.empty());
}

TEST_F(MeshImport, UpAxisAndScaleCanBeSaid) {
  folder_.write("a.obj", "o qwfp\nv 0 0 0\nv 100 0 0\nv 0 200 0\nf 1 2 3\n");
  MeshFileOptions options;
  options.up = UpAxis::kZ;
  options.scale = 0.01;
  options.add_lights = false;
  const sim::MeshScene scene = load_mesh_file(folder_.path() / "a.obj", options);
  EXPECT_NEAR(scene.instances[0].box_max_m.x, 1.0, 1e-6);
  EXPECT_NEAR(scene.instances[0].box_max_m.y, 2.0, 1e-6);
  EXPECT_TRUE(scene.lights.empty());
  ASSERT_EQ(scene.warnings.size(), 1U) << "\"qwfp\" is no known name";
}

TEST_F(MeshImport, MissingTextureIsAWarningAndTheColourIsKept) {
  folder_.write("a.mtl", "newmtl m\nKd 1 0 0\nmap_Kd gone.png\n");
  folder_.write("a.obj",
                "mtllib a.mtl\no sofa\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\n"
                "f 1/1 2/1 3/1\n");
  const sim::MeshScene scene = load_mesh_file(folder_.path() / "a.obj");
  ASSERT_EQ(scene.warnings.size(), 1U);
  EXPECT_THAT(scene.warnings[0], HasSubstr("gone.png"));
  const sim::Material& material =
      scene.materials[static_cast<std::size_t>(scene.meshes[0].material)];
  EXPECT_EQ(material.texture, -1);
  EXPECT_EQ(material.albedo, glm::vec3(1, 0, 0));
}

TEST_F(MeshImport, AWindowsTexturePathIsFoundByItsBaseName) {
  std::filesystem::create_directories(folder_.path() / "materials" / "textures");
  write_png_2x2(folder_.path() / "materials" / "textures" / "wood.png");
  folder_.write("meshes/a.mtl", "newmtl m\nmap_Kd C:\\artist\\files\\wood.psd\n");
  folder_.write("meshes/a.obj",
                "mtllib a.mtl\no sofa\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\n"
                "f 1/1 2/1 3/1\n");
  const sim::MeshScene scene = load_mesh_file(folder_.path() / "meshes" / "a.obj");
  ASSERT_EQ(scene.textures.size(), 1U);
  EXPECT_EQ(scene.textures[0].width_px(), 2);
  EXPECT_TRUE(scene.warnings.empty());
  const sim::MeshScene shape =
      load_mesh_file(folder_.path() / "meshes" / "a.obj", {}, blank_textures());
  ASSERT_EQ(shape.textures.size(), 1U);
  EXPECT_EQ(shape.textures[0].width_px(), 1);
  EXPECT_EQ(shape.meshes[0].positions_m, scene.meshes[0].positions_m);
}

TEST_F(MeshImport, ColladaAppliesUnitAndNodesAndFlipsMirroredFaces) {
  folder_.write("meshes/tri.dae",
                collada_triangle("0.01", "-1 0 0 0  0 2 0 0  0 0 1 300  0 0 0 1"));
  const sim::MeshScene scene = load_mesh_file(folder_.path() / "meshes" / "tri.dae");
  ASSERT_EQ(scene.meshes.size(), 1U);
  const sim::SubMesh& mesh = scene.meshes[0];
  // Vertices (0,0,0), (100,0,0), (0,100,0) become (0,0,3), (-1,0,3), (0,2,3): z stays up.
  EXPECT_NEAR(scene.instances[0].box_min_m.x, -1.0, 1e-6);
  EXPECT_NEAR(scene.instances[0].box_max_m.y, 2.0, 1e-6);
  EXPECT_NEAR(scene.instances[0].box_min_m.z, 3.0, 1e-6);
  const glm::uvec3& t = mesh.triangles[0];
  const glm::vec3 cross = glm::cross(mesh.positions_m[t.y] - mesh.positions_m[t.x],
                                     mesh.positions_m[t.z] - mesh.positions_m[t.x]);
  EXPECT_GT(cross.z, 0.0F) << "the face still looks up";
}

/// The message of load_mesh_file.
std::string refusal(const std::filesystem::path& file) {
  try {
    (void)load_mesh_file(file);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST_F(MeshImport, FilesOfOtherKindsAreRefused) {
  folder_.write("a.xml", collada_triangle("0.01", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"));
  EXPECT_THAT(refusal(folder_.path() / "a.xml"), HasSubstr(".stl, found .xml"));
}

TEST_F(MeshImport, BadFilesAreInputErrors) {
  EXPECT_THROW((void)load_mesh_file(folder_.path() / "none.obj"), core::InputError);
  folder_.write("text.ply", "this is no mesh");
  EXPECT_THROW((void)load_mesh_file(folder_.path() / "text.ply"), core::InputError);
  folder_.write("points.obj", "v 0 0 0\nv 1 1 1\n");
  EXPECT_THROW((void)load_mesh_file(folder_.path() / "points.obj"), core::InputError);
  folder_.write("far.obj", "o box\nv 0 0 0\nv 1e60 0 0\nv 0 1 0\nf 1 2 3\n");
  EXPECT_THROW((void)load_mesh_file(folder_.path() / "far.obj"), core::InputError)
      << "a coordinate that overflows to infinity";
}

/// assimp would append indices until memory ends.
TEST_F(MeshImport, AWordAmongTheIndicesOfColladaIsRefused) {
  const std::string good = collada_triangle("0.01", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1");
  folder_.write("good.dae", good);
  EXPECT_EQ(refusal(folder_.path() / "good.dae"), "no error");
  for (const char* word : {"true", "1,5", "[[[", "99999999999"}) {
    std::string damaged = good;
    damaged.replace(damaged.find("<p>0 1 2"), 8, std::string("<p>0 ") + word + " 2");
    folder_.write("a.dae", damaged);
    EXPECT_THAT(refusal(folder_.path() / "a.dae"), HasSubstr("a.dae:9: expected indices"));
  }
}

/// assimp would read beyond them.
TEST_F(MeshImport, AccessorsOfColladaBeyondTheirArraysAreRefused) {
  const auto error_with = [&](const std::string& from, const std::string& to) {
    std::string text = collada_triangle("0.01", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1");
    text.replace(text.find(from), from.size(), to);
    folder_.write("a.dae", text);
    return refusal(folder_.path() / "a.dae");
  };
  EXPECT_THAT(
      error_with("count=\"9\"", "count=\"8\""),
      HasSubstr("an accessor of source \"p\" within the 8 entries of its array, found 9"));
  EXPECT_THAT(error_with("stride=", "offset='1' stride="), HasSubstr("found 10"));
  EXPECT_THAT(error_with("count=\"3\"", "count=\"-1\""), HasSubstr("found \"-1\""));
  EXPECT_THAT(error_with("<float_array id=\"pa\" count=\"9\">0 0 0 100 0 0 0 100 0</float",
                         "<Name_array id=\"pa\" count=\"9\">a b c d e f g h i</Name"),
              HasSubstr("expected numbers of corners, found names: p"));
  // What assimp reads otherwise than the check would.
  EXPECT_THAT(error_with("source=\"#pa\"", "source=\"&#35;pa\""),
              HasSubstr("a name without & for source"));
  EXPECT_THAT(error_with("<accessor ", "<accessor name='x>y' offset='1' "),
              HasSubstr("found 10"));
  EXPECT_EQ(error_with("<vertices", "<!-- <accessor count='x'/> --><vertices"), "no error");
  // Parameters of what is no accessor are none of it.
  EXPECT_EQ(error_with("<vertices", "<x><param/></x><vertices"), "no error");
}

TEST_F(MeshImport, PolygonsThatTakeTooLongToCutAreRefused) {
  std::string text = "o chair\n", face = "f";
  for (int k = 0; k < 3000; ++k) {
    text += "v " + std::to_string(k) + " 0 0\n";
    face += " " + std::to_string(k + 1);
  }
  folder_.write("a.obj", text + face + "\n");
  EXPECT_THAT(refusal(folder_.path() / "a.obj"),
              HasSubstr("expected polygons of 1 to 1024 corners, found one of 3000"));
}

TEST_F(MeshImport, VerticesBeyondAnyWorldAreRefused) {
  folder_.write("a.obj", "o chair\nv 0 0 0\nv 1 0 0\nv 0 4294967296 0\nf 1 2 3\n");
  EXPECT_THAT(refusal(folder_.path() / "a.obj"), HasSubstr("finite vertices within 1e+07 m"));
}

TEST_F(MeshImport, PipesAreNotOpened) {
  ASSERT_EQ(::mkfifo((folder_.path() / "pipe").c_str(), 0600), 0);
  folder_.write("a.obj", "mtllib pipe\no chair\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  EXPECT_EQ(load_mesh_file(folder_.path() / "a.obj").triangle_count(), 1U);
  EXPECT_THAT(refusal(folder_.path() / "pipe"), HasSubstr("expected a mesh file"));
}

}  // namespace
}  // namespace segsim::worlds
