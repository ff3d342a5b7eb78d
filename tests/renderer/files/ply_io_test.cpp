#include "renderer/files/ply_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

class PlyIo : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::path(::testing::TempDir()) / (std::string("ply_io_") + info->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  fs::path write_text(const std::string& text) {
    const fs::path file = folder_ / "scene.ply";
    std::ofstream(file, std::ios::binary) << text;
    return file;
  }
  std::string error_of(const fs::path& file) {
    try {
      static_cast<void>(read_surfels_ply(file));
    } catch (const core::InputError& error) {
      return error.what();
    }
    return "no error";
  }

  fs::path folder_;
};

SurfelCloud cloud_of_degree(int degree) {
  SurfelCloud cloud = testing::random_scene(11, 50);
  core::RandomStream random(5, "sh");
  cloud.sh_degree = degree;
  cloud.sh.resize(cloud.size() * cloud.sh_count());
  for (glm::vec3& c : cloud.sh) {
    c = {static_cast<float>(random.normal()), static_cast<float>(random.normal()),
         static_cast<float>(random.normal())};
  }
  return cloud;
}

void expect_equal(const SurfelCloud& a, const SurfelCloud& b) {
  ASSERT_EQ(a.size(), b.size());
  ASSERT_EQ(a.sh_degree, b.sh_degree);
  EXPECT_EQ(a.semantic_id, b.semantic_id);
  EXPECT_EQ(a.instance_id, b.instance_id);
  EXPECT_EQ(a.sh, b.sh);
  EXPECT_EQ(a.semantic_feature, b.semantic_feature);
  EXPECT_EQ(a.instance_feature, b.instance_feature);
  EXPECT_EQ(a.position_m, b.position_m);
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_NEAR(a.opacity[i], b.opacity[i], 1e-6F);
    EXPECT_NEAR(a.scale_m[i].x, b.scale_m[i].x, 1e-6F * a.scale_m[i].x);
    EXPECT_NEAR(a.scale_m[i].y, b.scale_m[i].y, 1e-6F * a.scale_m[i].y);
    EXPECT_NEAR(a.R_world_surfel[i].w, b.R_world_surfel[i].w, 1e-6F);
    EXPECT_NEAR(a.R_world_surfel[i].x, b.R_world_surfel[i].x, 1e-6F);
    EXPECT_NEAR(a.R_world_surfel[i].y, b.R_world_surfel[i].y, 1e-6F);
    EXPECT_NEAR(a.R_world_surfel[i].z, b.R_world_surfel[i].z, 1e-6F);
  }
}

TEST_F(PlyIo, RoundTripOfEveryDegree) {
  for (int degree = 0; degree <= 3; ++degree) {
    const SurfelCloud cloud = cloud_of_degree(degree);
    write_surfels_ply(folder_ / "scene.ply", cloud);
    expect_equal(cloud, read_surfels_ply(folder_ / "scene.ply"));
  }
}

TEST_F(PlyIo, FeaturesSurviveARoundTrip) {
  SurfelCloud cloud = cloud_of_degree(1);
  EXPECT_FALSE(cloud.has_features());
  testing::add_random_features(cloud, 3);
  write_surfels_ply(folder_ / "scene.ply", cloud);
  expect_equal(cloud, read_surfels_ply(folder_ / "scene.ply"));
  cloud.semantic_id.clear();
  cloud.instance_id.clear();
  write_surfels_ply(folder_ / "scene.ply", cloud);
  expect_equal(cloud, read_surfels_ply(folder_ / "scene.ply"));
}

TEST_F(PlyIo, FeaturesAreAllThereOrNone) {
  SurfelCloud cloud = cloud_of_degree(0);
  testing::add_random_features(cloud, 3);
  write_surfels_ply(folder_ / "good.ply", cloud);
  const std::string good = core::read_file(folder_ / "good.ply");
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string bytes = good;
    bytes.replace(bytes.find(from), from.size(), to);
    return error_of(write_text(bytes));
  };
  EXPECT_THAT(
      with("float sem_f_7\n", "float other_7\n"),
      HasSubstr("expected no features or all of sem_f_0 ... 15, found 15 of them and 0"));
  EXPECT_THAT(with("float ins_f_31\n", "float ins_f_32\n"),
              HasSubstr("all of ins_f_0 ... 31, found 31 of them and 1 others"));
  std::string only_semantic = good;
  for (std::size_t at; (at = only_semantic.find("ins_f_")) != std::string::npos;) {
    only_semantic.replace(at, 6, "other_");
  }
  EXPECT_THAT(error_of(write_text(only_semantic)), HasSubstr("found 0 of them and 0 others"));
  std::string not_finite = good;
  const float nan = std::nanf("");
  // Feature 0 of the last of 50 vertices: 48 floats and two labels of 16 bits from the end.
  std::memcpy(not_finite.data() + not_finite.size() - 4 - 48 * 4, &nan, 4);
  EXPECT_THAT(error_of(write_text(not_finite)),
              HasSubstr("vertex 49: expected a finite feature"));
}

TEST_F(PlyIo, UnlabelledSceneStaysUnlabelled) {
  SurfelCloud cloud = cloud_of_degree(0);
  cloud.semantic_id.clear();
  cloud.instance_id.clear();
  write_surfels_ply(folder_ / "scene.ply", cloud);
  EXPECT_THAT(core::read_file(folder_ / "scene.ply"), Not(HasSubstr("semantic_id")));
  EXPECT_FALSE(read_surfels_ply(folder_ / "scene.ply").has_labels());
}

TEST_F(PlyIo, DegreeThreeIsTheOfficialLayout) {
  SurfelCloud cloud = cloud_of_degree(3);
  cloud.semantic_id.clear();
  cloud.instance_id.clear();
  write_surfels_ply(folder_ / "scene.ply", cloud);
  const std::string bytes = core::read_file(folder_ / "scene.ply");
  const std::size_t body = bytes.find("end_header\n") + 11;
  EXPECT_EQ(bytes.size() - body, cloud.size() * 61 * 4);
  EXPECT_THAT(bytes.substr(0, body),
              AllOf(HasSubstr("property float z\nproperty float nx\n"),
                    HasSubstr("property float f_rest_44\nproperty float opacity\n"
                              "property float scale_0\nproperty float scale_1\n"
                              "property float rot_0\n")));
  // Red, then green, then blue: coefficient 1 of green is the 16th f_rest.
  float green = 0.0F;
  std::memcpy(&green, bytes.data() + body + (9 + 15) * 4, 4);
  EXPECT_EQ(green, cloud.sh[1].g);
}

constexpr const char* kAsciiBody = "0.1 0.2 0.3 0 -4 -5 2 0 0 0 0.5 0.25 -0.5 7\n";
std::string ascii_header(const std::string& count) {
  return "ply\nformat ascii 1.0\ncomment by hand\nelement vertex " + count +
         "\nproperty float f_dc_0\nproperty float f_dc_1\nproperty double f_dc_2\n"
         "property float opacity\nproperty float scale_0\nproperty float scale_1\n"
         "property float rot_0\nproperty float rot_1\nproperty float rot_2\n"
         "property float rot_3\nproperty float z\nproperty float y\nproperty float x\n"
         "property uchar extra\nelement face 0\nproperty list uchar int vertex_indices\n"
         "end_header\n";
}

TEST_F(PlyIo, PropertiesAreFoundByNameAndActivated) {
  const SurfelCloud cloud = read_surfels_ply(write_text(ascii_header("1") + kAsciiBody));
  ASSERT_EQ(cloud.size(), 1U);
  EXPECT_EQ(cloud.position_m[0], glm::vec3(-0.5F, 0.25F, 0.5F));
  EXPECT_EQ(cloud.sh[0], glm::vec3(0.1F, 0.2F, 0.3F));
  EXPECT_FLOAT_EQ(cloud.opacity[0], 0.5F);
  EXPECT_FLOAT_EQ(cloud.scale_m[0].x, std::exp(-4.0F));
  EXPECT_FLOAT_EQ(cloud.scale_m[0].y, std::exp(-5.0F));
  EXPECT_FLOAT_EQ(cloud.R_world_surfel[0].w, 1.0F);
  EXPECT_FALSE(cloud.has_labels());
}

TEST_F(PlyIo, ThirdScaleIsIgnored) {
  std::string text = ascii_header("1") + kAsciiBody;
  text.replace(text.find("uchar extra"), 11, "float scale_2");
  EXPECT_FLOAT_EQ(read_surfels_ply(write_text(text)).scale_m[0].x, std::exp(-4.0F));
}

TEST_F(PlyIo, MissingPropertyIsNamedWithThoseThatAreThere) {
  std::string text = ascii_header("1") + kAsciiBody;
  text.replace(text.find("rot_3"), 5, "wot_3");
  EXPECT_THAT(error_of(write_text(text)),
              AllOf(HasSubstr("scene.ply: expected property rot_3, found"), HasSubstr("rot_2"),
                    HasSubstr("wot_3")));
}

TEST_F(PlyIo, TruncatedBodyGivesByteCounts) {
  write_surfels_ply(folder_ / "scene.ply", cloud_of_degree(0));
  std::string bytes = core::read_file(folder_ / "scene.ply");
  bytes.resize(bytes.size() - 30);
  EXPECT_THAT(error_of(write_text(bytes)),
              AllOf(HasSubstr("expected 50 x 68 bytes"), HasSubstr("found 3370 bytes")));
  EXPECT_THAT(error_of(write_text(ascii_header("2") + kAsciiBody)),
              HasSubstr("expected 28 values after the header, found 14"));
}

TEST_F(PlyIo, DamagedHeadersAreRefused) {
  const std::string good = ascii_header("1") + kAsciiBody;
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    text.replace(text.find(from), from.size(), to);
    return error_of(write_text(text));
  };
  EXPECT_THAT(error_of(folder_ / "missing.ply"), HasSubstr("missing.ply"));
  EXPECT_THAT(error_of(write_text("")), HasSubstr("expected a PLY header"));
  EXPECT_THAT(with("ply\n", "plx\n"), HasSubstr("expected \"ply\""));
  EXPECT_THAT(with("format ascii", "format binary_big_endian"),
              HasSubstr("binary_little_endian"));
  EXPECT_THAT(with("format ascii 1.0\n", ""), HasSubstr("format"));
  EXPECT_THAT(with("element vertex 1", "element vertex -1"), HasSubstr("one element vertex"));
  EXPECT_THAT(with("element vertex", "element face"),
              HasSubstr("vertex as the first element"));
  EXPECT_THAT(with("property float z", "property list uchar int z"), HasSubstr("scalar"));
  EXPECT_THAT(with("property float z", "property float x"), HasSubstr("one property x"));
  EXPECT_THAT(with("uchar extra", "float f_rest_0"), HasSubstr("f_rest"));
  EXPECT_THAT(with("end_header\n", ""), HasSubstr("end_header"));
  EXPECT_THAT(with("element vertex 1\n", "element vertex 999999999999\n"),
              HasSubstr("expected 999999999999 vertices"));
  EXPECT_THAT(with("uchar extra", "uchar semantic_id"),
              HasSubstr("expected property instance_id"));
}

TEST_F(PlyIo, UnusableValuesNameTheVertex) {
  const auto with_body = [&](const std::string& body) {
    return error_of(write_text(ascii_header("1") + body));
  };
  EXPECT_THAT(with_body("0.1 0.2 0.3 0 -4 -5 0 0 0 0 0.5 0.25 -0.5 7\n"),
              HasSubstr("vertex 0: expected a rotation quaternion"));
  EXPECT_THAT(with_body("0.1 0.2 0.3 0 -4 -5 1 0 0 0 0.5 0.25 nan 7\n"),
              HasSubstr("vertex 0: expected a finite position"));
  EXPECT_THAT(with_body("0.1 0.2 0.3 0 400 -5 1 0 0 0 0.5 0.25 0 7\n"),
              HasSubstr("log-scale"));
  EXPECT_THAT(with_body("0.1 0.2 apple 0 -4 -5 1 0 0 0 0.5 0.25 0 7\n"),
              HasSubstr("expected a number"));
}

TEST_F(PlyIo, BrokenCloudsAreNotWritten) {
  SurfelCloud cloud = cloud_of_degree(0);
  cloud.opacity[3] = 0.0F;
  EXPECT_THROW(write_surfels_ply(folder_ / "scene.ply", cloud), core::ContractViolation);
  EXPECT_FALSE(fs::exists(folder_ / "scene.ply"));
}

TEST_F(PlyIo, WhatAsksForTooMuchIsRefused) {
  std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n";
  for (int k = 0; k < 2000; ++k) header += "property char p" + std::to_string(k) + "\n";
  EXPECT_THAT(error_of(write_text(header + "end_header\n" + std::string(2000, 'x'))),
              HasSubstr("expected at most 1024 properties"));
  SurfelCloud cloud = cloud_of_degree(0);
  cloud.position_m[7].y = 1e30F;
  write_surfels_ply(folder_ / "scene.ply", cloud);
  EXPECT_THAT(error_of(folder_ / "scene.ply"),
              HasSubstr("vertex 7: expected a position within 1e7 m"));
}

}  // namespace
}  // namespace segsim::renderer
