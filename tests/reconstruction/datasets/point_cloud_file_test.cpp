#include "reconstruction/datasets/point_cloud_file.h"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include <gmock/gmock.h>

#include "tests/error_message.h"
#include "tests/reconstruction/tiny_sequence.h"

namespace segsim::reconstruction {
namespace {

using ::testing::HasSubstr;
using tests::input_error_of;

const std::string kPcdHeader =
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
    "WIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\n";
const std::string kPlyHeader =
    "element vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";

template <class Value>
void append(std::string& bytes, Value value) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof value);
  bytes.append(raw, sizeof value);
}

class PointCloudFile : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& name, const std::string& bytes) const {
    const auto file = folder_.path() / name;
    std::ofstream(file, std::ios::binary) << bytes;
    return file;
  }
  [[nodiscard]] std::string error_of(const std::string& name, const std::string& bytes) const {
    const auto file = write(name, bytes);
    return input_error_of([&] { (void)read_point_cloud(file); });
  }

  testing::TemporaryFolder folder_{"point_cloud_file"};
};

TEST_F(PointCloudFile, AsciiPcdWithPackedColors) {
  // 0x0A141E = (10, 20, 30). The second point has no echo.
  const PointCloud cloud = read_point_cloud(write(
      "a.pcd", kPcdHeader + "DATA ascii\n1 2 3 660510\nnan nan nan 0\n-4 5.5 6 16711935\n"));
  ASSERT_EQ(cloud.position_m.size(), 2U);
  EXPECT_EQ(cloud.position_m[0], glm::vec3(1.0F, 2.0F, 3.0F));
  EXPECT_EQ(cloud.position_m[1], glm::vec3(-4.0F, 5.5F, 6.0F));
  ASSERT_EQ(cloud.rgb.size(), 2U);
  EXPECT_EQ(cloud.rgb[0], (core::Rgb8{10, 20, 30}));
  EXPECT_EQ(cloud.rgb[1], (core::Rgb8{255, 0, 255}));
}

TEST_F(PointCloudFile, BinaryPcdOfDoublesWithoutColors) {
  std::string bytes =
      "VERSION 0.7\nFIELDS intensity x y z\nSIZE 4 8 8 8\nTYPE F F F F\nCOUNT 1 1 1 1\n"
      "WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA binary\n";
  for (const double x : {1.25, -7.5}) {
    append(bytes, 0.5F);
    append(bytes, x);
    append(bytes, 2.0);
    append(bytes, 3.0);
  }
  const PointCloud cloud = read_point_cloud(write("b.pcd", bytes));
  ASSERT_EQ(cloud.position_m.size(), 2U);
  EXPECT_EQ(cloud.position_m[1], glm::vec3(-7.5F, 2.0F, 3.0F));
  EXPECT_TRUE(cloud.rgb.empty());
}

TEST_F(PointCloudFile, PlyOfBothKinds) {
  std::string binary = "ply\nformat binary_little_endian 1.0\n" + kPlyHeader;
  for (const float x : {1.0F, 2.0F}) {
    append(binary, x);
    append(binary, 3.0F);
    append(binary, 4.0F);
    binary += "\x0A\x14\x1E";
  }
  const std::string ascii =
      "ply\nformat ascii 1.0\n" + kPlyHeader + "1 3 4 10 20 30\n2 3 4 10 20 30\n";
  // The name says nothing.
  for (const std::string& bytes : {binary, ascii}) {
    const PointCloud cloud = read_point_cloud(write("cloud", bytes));
    ASSERT_EQ(cloud.position_m.size(), 2U);
    EXPECT_EQ(cloud.position_m[1], glm::vec3(2.0F, 3.0F, 4.0F));
    ASSERT_EQ(cloud.rgb.size(), 2U);
    EXPECT_EQ(cloud.rgb[1], (core::Rgb8{10, 20, 30}));
  }
}

TEST_F(PointCloudFile, ColorsOfAPlyAreTakenIfAllAreThere) {
  std::string header = kPlyHeader;
  header.replace(header.find("property uchar red\nproperty uchar green\n"), 40, "");
  const PointCloud cloud = read_point_cloud(
      write("a.ply", "ply\nformat ascii 1.0\n" + header + "1 3 4 30\n2 3 nan 30\n"));
  ASSERT_EQ(cloud.position_m.size(), 1U);
  EXPECT_TRUE(cloud.rgb.empty());
  EXPECT_THAT(error_of("b.ply",
                       "ply\nformat ascii 1.0\nelement vertex 1\n"
                       "property float x\nproperty int y\nend_header\n1 2\n"),
              HasSubstr("b.ply: expected a property y of floats"));
}

TEST_F(PointCloudFile, BadFilesAreNamed) {
  EXPECT_THAT(input_error_of([&] { (void)read_point_cloud(folder_.path() / "nothing.pcd"); }),
              ::testing::AllOf(HasSubstr("nothing.pcd"), HasSubstr("no such file")));
  EXPECT_THAT(input_error_of([&] { (void)read_point_cloud(folder_.path()); }),
              HasSubstr("no such file"));
  EXPECT_THAT(error_of("a.pcd", ""), HasSubstr("header of a PCD or PLY file"));
  EXPECT_THAT(error_of("a.ply", "solid cube\n"), HasSubstr("header of a PCD or PLY file"));
  EXPECT_THAT(
      error_of("a.pcd", kPcdHeader + "DATA ascii\nnan nan nan 0\nnan 1 2 0\ninf 1 2 0\n"),
      HasSubstr("expected points with finite coordinates, found none among 3"));
  std::string flat = kPcdHeader;
  flat.replace(flat.find("x y z rgb"), 9, "x y i rgb");
  EXPECT_THAT(error_of("a.pcd", flat + "DATA ascii\n1 2 3 0\n1 2 3 0\n1 2 3 0\n"),
              ::testing::AllOf(HasSubstr("a field z of floats"), HasSubstr("x y i rgb")));
}

/// PCL passes over empty lines alone.
TEST_F(PointCloudFile, BlanksBetweenTheLinesOfAPcdHeaderAreRefused) {
  const std::string points = "DATA ascii\n1 2 3 0\n1 2 3 0\n1 2 3 0\n";
  const auto header_with = [](const std::string& line) {
    std::string header = kPcdHeader;
    return header.insert(header.find("FIELDS"), line);
  };
  EXPECT_EQ(error_of("a.pcd", header_with("\n") + points), "no error");
  for (const char* line : {"\r\n", " \t\n", "\v\n"}) {
    EXPECT_THAT(error_of("a.pcd", header_with(line) + points), HasSubstr("a.pcd: expected"));
  }
}

TEST_F(PointCloudFile, CutFilesAreRefused) {
  std::string pcd = kPcdHeader + "DATA binary\n";
  for (int i = 0; i < 9; ++i) append(pcd, 1.0F);  // 12 are announced.
  EXPECT_THAT(error_of("a.pcd", pcd), HasSubstr("a.pcd: expected all points"));
  EXPECT_THAT(error_of("a.pcd", kPcdHeader + "DATA ascii\n1 2 3 0\n"),
              HasSubstr("a.pcd: expected"));
  std::string ply = "ply\nformat binary_little_endian 1.0\n" + kPlyHeader;
  append(ply, 1.0F);
  EXPECT_THAT(error_of("a.ply", ply), HasSubstr("a.ply: expected all bytes of a PLY file"));
  EXPECT_THAT(error_of("a.ply", "ply\nformat ascii 1.0\n" + kPlyHeader + "1 3 4 1 2 3\n"),
              HasSubstr("a.ply: expected all numbers of a PLY file"));
  EXPECT_THAT(error_of("a.ply", "ply\nformat ascii 1.0\nelement vertex 2\n"),
              HasSubstr("a.ply: expected a PLY header that ends"));
}

}  // namespace
}  // namespace segsim::reconstruction
