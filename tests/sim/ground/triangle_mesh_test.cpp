#include "sim/ground/triangle_mesh.h"

#include <fstream>
#include <limits>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "tests/box_mesh.h"
#include "tests/error_message.h"

namespace segsim::sim {
namespace {

using ::testing::HasSubstr;

class TriangleMeshFile : public testing::Test {
 protected:
  std::filesystem::path file_ =
      std::filesystem::path(testing::TempDir()) / "segsim_mesh_test.ply";
  void TearDown() override { std::filesystem::remove(file_); }
  void write(const std::string& text) const { std::ofstream(file_, std::ios::binary) << text; }
};

TEST(TriangleMesh, BoxIsClosedAndFacesOutwards) {
  TriangleMesh mesh;
  append_box(mesh, {1, 2, 3}, {2, 4, 6});
  // Divergence theorem: signed volume of the tetrahedra to the origin.
  double volume = 0.0;
  for (const glm::uvec3& t : mesh.triangles) {
    volume += glm::dot(glm::dvec3(mesh.positions_m[t.x]),
                       glm::cross(glm::dvec3(mesh.positions_m[t.y]),
                                  glm::dvec3(mesh.positions_m[t.z]))) /
              6.0;
  }
  EXPECT_NEAR(volume, 1.0 * 2.0 * 3.0, 1e-6);
}

TEST_F(TriangleMeshFile, RoundTrip) {
  TriangleMesh mesh;
  append_box(mesh, {-1, 0.1F, 0}, {2, 3, 1});
  append_floor(mesh, 0, 0, 5, 5);
  write_mesh_ply(file_, mesh);
  const TriangleMesh back = read_mesh_ply(file_);
  EXPECT_EQ(back.positions_m, mesh.positions_m);
  EXPECT_EQ(back.triangles, mesh.triangles);
}

TEST_F(TriangleMeshFile, ReadsDoublesExtraPropertiesAndQuads) {
  std::string text =
      "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty uchar red\n"
      "property double x\nproperty double y\nproperty double z\nelement face 1\n"
      "property list uchar uint vertex_index\nend_header\n";
  const auto put = [&text](const auto value) {
    text.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  for (int k = 0; k < 4; ++k) {
    put(std::uint8_t{7});
    put(static_cast<double>(k));
    put(0.5);
    put(-1.0);
  }
  put(std::uint8_t{4});
  for (std::uint32_t k = 0; k < 4; ++k) put(k);
  write(text);
  const TriangleMesh mesh = read_mesh_ply(file_);
  ASSERT_EQ(mesh.triangles.size(), 2U);
  EXPECT_EQ(mesh.triangles[1], glm::uvec3(0, 2, 3));
  EXPECT_EQ(mesh.positions_m[3], glm::vec3(3.0F, 0.5F, -1.0F));
}

TEST_F(TriangleMeshFile, RefusesBrokenFiles) {
  TriangleMesh mesh;
  append_floor(mesh, 0, 0, 1, 1);
  write_mesh_ply(file_, mesh);
  const std::string good = core::read_file(file_);

  write(good.substr(0, good.size() - 5));
  EXPECT_THROW((void)read_mesh_ply(file_), core::InputError);
  write("solid stl\n");
  EXPECT_THROW((void)read_mesh_ply(file_), core::InputError);
  write("ply\nformat ascii 1.0\nelement vertex 0\nend_header\n");
  EXPECT_THROW((void)read_mesh_ply(file_), core::InputError);
  write(good.substr(0, 60));
  EXPECT_THROW((void)read_mesh_ply(file_), core::InputError);

  mesh.triangles[0].x = 99;
  write_mesh_ply(file_, mesh);
  EXPECT_THROW((void)read_mesh_ply(file_), core::InputError);
  mesh.triangles[0].x = 0;
  mesh.positions_m[2].y = std::numeric_limits<float>::quiet_NaN();
  write_mesh_ply(file_, mesh);
  EXPECT_THROW((void)read_mesh_ply(file_), core::InputError);
  EXPECT_THROW((void)read_mesh_ply(file_.string() + ".none"), core::InputError);
}

TEST_F(TriangleMeshFile, RefusesWhatAsksForTooMuch) {
  TriangleMesh mesh;
  append_floor(mesh, 0, 0, 1, 1);
  mesh.positions_m[2].y = 1e30F;
  write_mesh_ply(file_, mesh);
  EXPECT_THAT(tests::input_error_of([&] { (void)read_mesh_ply(file_); }),
              HasSubstr("vertex 2: expected finite coordinates within"));

  // 100 bytes announce 10^8 vertices.
  write(
      "ply\nformat binary_little_endian 1.0\nelement vertex 100000000\nproperty float x\n"
      "property float y\nproperty float z\nend_header\n" +
      std::string(100, 'x'));
  EXPECT_THAT(tests::input_error_of([&] { (void)read_mesh_ply(file_); }),
              HasSubstr("expected more data"));

  // Nothing, not even the end of a line, behind the header.
  write(
      "ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\n"
      "property float y\nproperty float z\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header");
  EXPECT_THAT(tests::input_error_of([&] { (void)read_mesh_ply(file_); }),
              HasSubstr("expected more data"));

  std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n";
  for (int k = 0; k < 2000; ++k) header += "property char p" + std::to_string(k) + "\n";
  write(header + "end_header\n");
  EXPECT_THAT(tests::input_error_of([&] { (void)read_mesh_ply(file_); }),
              HasSubstr("at most 1024 properties"));
}

}  // namespace
}  // namespace segsim::sim
