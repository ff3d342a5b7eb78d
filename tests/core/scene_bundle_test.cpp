#include "core/scene_bundle.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/bundle_parts.h"
#include "core/error.h"
#include "core/file_io.h"

namespace segsim::core {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class SceneBundleTest : public ::testing::Test {
 protected:
  SceneBundleTest()
      : folder_(fs::temp_directory_path() / ("segsim_bundle_" + std::to_string(::getpid()))) {
    for (const char* name : {"surfels.ply", "collision.ply", "navmesh.bin"}) {
      write_file_atomically(folder_ / name, [&](std::ostream& out) { out << name; });
    }
    SceneManifest m;
    m.name = "test room";
    m.created_by = "test";
    m.source = "made up";
    m.origin = {30.263, 120.123, 10.0, 0.25};
    m.robot_radius_m = 0.33;
    m.robot_height_m = 0.3;
    m.camera_height_m = 1.2;
    m.classes = {{1, "chair", true}, {2, "wall", false}};
    m.instances = {{7, 1, "ChairA_01", {0, 0, 0}, {0.5, 0.5, 1.0}}};
    m.surfels.name = "surfels.ply";
    m.collision_mesh.name = "collision.ply";
    m.navmesh.name = "navmesh.bin";
    m.statistics = {{"frames_used", 12.0}};
    write_bundle_manifest(folder_, m);
  }
  ~SceneBundleTest() override { fs::remove_all(folder_); }

  /// Replaces `from` by `to` in scene.yaml.
  void edit(const std::string& from, const std::string& to) const {
    std::string text = read_file(folder_ / "scene.yaml");
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    write_file_atomically(folder_ / "scene.yaml", [&](std::ostream& out) { out << text; });
  }
  [[nodiscard]] std::string refusal() const {
    try {
      (void)load_bundle(folder_);
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  }
  fs::path folder_;
};

TEST_F(SceneBundleTest, RoundTripKeepsEverything) {
  const SceneBundle bundle = load_bundle(folder_);
  const SceneManifest& m = bundle.manifest;
  EXPECT_EQ(m.name, "test room");
  EXPECT_DOUBLE_EQ(m.origin.longitude_deg, 120.123);
  ASSERT_EQ(m.classes.size(), 2U);
  EXPECT_TRUE(m.classes[0].thing);
  ASSERT_NE(m.find_instance(7), nullptr);
  EXPECT_EQ(m.class_name(m.find_instance(7)->class_id), "chair");
  EXPECT_DOUBLE_EQ(m.find_instance(7)->box_max_m.z, 1.0);
  EXPECT_EQ(m.class_name(99), "void");
  EXPECT_EQ(m.statistics.at(0).first, "frames_used");
}

TEST_F(SceneBundleTest, DamagedFileIsRefusedWithBothHashes) {
  std::ofstream(folder_ / "surfels.ply", std::ios::app) << "x";
  EXPECT_THAT(refusal(), HasSubstr("surfels.ply: expected SHA-256"));
}

TEST_F(SceneBundleTest, MissingFileIsNamed) {
  fs::remove(folder_ / "navmesh.bin");
  EXPECT_THAT(refusal(), HasSubstr("navmesh.bin: expected a bundle file, found none"));
}

TEST_F(SceneBundleTest, OtherVersionIsRefused) {
  edit("version: 2", "version: 5");
  EXPECT_THAT(refusal(), HasSubstr("scene.yaml:2: version: expected version 1 to 4 (a newer "
                                   "bundle needs a newer program), found 5"));
  edit("version: 5", "version: 0");
  EXPECT_THAT(refusal(), HasSubstr("found 0"));
}

TEST_F(SceneBundleTest, PartsOfVersion2ComeBack) {
  write_file_atomically(folder_ / "labels.bin", [](std::ostream& out) { out << "shares"; });
  BundleParts parts;
  parts.labels.name = "labels.bin";
  parts.mesh_source = "fused depth of 12 rendered views";
  parts.levelling = {glm::angleAxis(0.01, glm::dvec3(0.0, 1.0, 0.0)), {0.0, 0.0, -0.0625}};
  write_bundle_manifest(folder_, load_bundle(folder_).manifest, parts);

  EXPECT_EQ(load_bundle(folder_).manifest.name, "test room");
  const BundleParts read = load_bundle_parts(folder_);
  EXPECT_EQ(read.version, 2);
  EXPECT_EQ(read.labels.name, "labels.bin");
  EXPECT_EQ(read.labels.sha256, sha256_hex(std::string("shares")));
  EXPECT_EQ(read.mesh_source, parts.mesh_source);
  EXPECT_NEAR(read.levelling.R_world_source.y, parts.levelling.R_world_source.y, 1e-12);
  EXPECT_DOUBLE_EQ(read.levelling.p_world_source_m.z, -0.0625);

  std::ofstream(folder_ / "labels.bin", std::ios::app) << "x";
  EXPECT_THAT(refusal(), HasSubstr("labels.bin: expected SHA-256"));
  fs::remove(folder_ / "labels.bin");
  EXPECT_THAT(refusal(), HasSubstr("labels.bin: expected a bundle file, found none"));
}

TEST_F(SceneBundleTest, LabelsSetByHandMakeAVersionOfTheirOwn) {
  write_file_atomically(folder_ / "label_edits_1.bin",
                        [](std::ostream& out) { out << "edits"; });
  BundleParts parts;
  parts.label_edits.name = "label_edits_1.bin";
  const SceneManifest m = load_bundle(folder_).manifest;
  write_bundle_manifest(folder_, m, parts);
  EXPECT_EQ(load_bundle_parts(folder_).version, 4);
  EXPECT_EQ(load_bundle_parts(folder_).label_edits.sha256, sha256_hex(std::string("edits")));
  EXPECT_FALSE(load_bundle_parts(folder_).rendering_only);

  // For rendering only as well.
  SceneManifest undrivable = m;
  undrivable.navmesh.name.clear();
  parts.rendering_only = RenderingOnly{"too narrow", "tank", std::nullopt, {}};
  write_bundle_manifest(folder_, undrivable, parts);
  EXPECT_EQ(load_bundle_parts(folder_).version, 4);
  EXPECT_EQ(load_bundle_parts(folder_).rendering_only->reason, "too narrow");
  EXPECT_THROW(require_drivable(load_bundle(folder_)), InputError);

  // An older version has no such key.
  write_bundle_manifest(folder_, m, {});
  EXPECT_EQ(load_bundle_parts(folder_).version, 2);
  edit("version: 2", "version: 4");
  EXPECT_THAT(refusal(), HasSubstr("label_edits"));
  write_file_atomically(folder_ / "label_edits_1.bin", [](std::ostream& out) { out << "?"; });
  parts.rendering_only.reset();
  write_bundle_manifest(folder_, m, parts);
  std::ofstream(folder_ / "label_edits_1.bin", std::ios::app) << "x";
  EXPECT_THAT(refusal(), HasSubstr("label_edits_1.bin: expected SHA-256"));
}

TEST_F(SceneBundleTest, WhyNothingDrivesComesBack) {
  EXPECT_NO_THROW(require_drivable(load_bundle(folder_)));
  const std::string drivable = read_file(folder_ / "scene.yaml");
  SceneManifest m = load_bundle(folder_).manifest;
  BundleParts parts;
  parts.rendering_only = RenderingOnly{"no walkable area for tank: \"wide\"",
                                       "tank",
                                       FreeDisc{{1.5, -2.25}, 0.275},
                                       {"cart", "mouse"}};
  const std::string navmesh = std::exchange(m.navmesh.name, "");
  fs::remove(folder_ / navmesh);
  write_bundle_manifest(folder_, m, parts);

  const BundleParts read = load_bundle_parts(folder_);
  EXPECT_EQ(read.version, 3);
  ASSERT_TRUE(read.rendering_only);
  EXPECT_EQ(read.rendering_only->reason, parts.rendering_only->reason);
  EXPECT_EQ(read.rendering_only->robot, "tank");
  EXPECT_EQ(read.rendering_only->fitting, parts.rendering_only->fitting);
  ASSERT_TRUE(read.rendering_only->free_disc);
  EXPECT_DOUBLE_EQ(read.rendering_only->free_disc->center_m.y, -2.25);
  EXPECT_DOUBLE_EQ(read.rendering_only->free_disc->radius_m, 0.275);
  const SceneBundle bundle = load_bundle(folder_);
  EXPECT_EQ(bundle.manifest.collision_mesh.name, "collision.ply");
  EXPECT_TRUE(bundle.manifest.navmesh.name.empty());
  try {
    require_drivable(bundle);
    FAIL() << "accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(
        std::string(error.what()),
        folder_.string() +
            ": expected a scene to drive in, found one for rendering and labels only (no "
            "walkable area for tank: \"wide\"; largest free disc: radius 0.28 m at (1.50, "
            "-2.25) m; robots that fit: cart, mouse); `segsim scene navmesh` tries another "
            "robot");
  }
  // Without floor there is no collision mesh either, no disc, and nothing that fits.
  m.collision_mesh.name.clear();
  parts.rendering_only = RenderingOnly{"no floor", "tank", std::nullopt, {}};
  write_bundle_manifest(folder_, m, parts);
  EXPECT_EQ(load_bundle_parts(folder_).rendering_only->text(),
            "no floor; no free disc on a floor");
  EXPECT_TRUE(load_bundle(folder_).manifest.collision_mesh.name.empty());
  // With a navmesh it is the same bundle as ever, to the byte.
  write_file_atomically(folder_ / navmesh, [&](std::ostream& out) { out << navmesh; });
  m.navmesh.name = navmesh;
  m.collision_mesh.name = "collision.ply";
  write_bundle_manifest(folder_, m);
  EXPECT_EQ(read_file(folder_ / "scene.yaml"), drivable);
}

TEST_F(SceneBundleTest, Version1IsReadAsNotLevelled) {
  std::string text = read_file(folder_ / "scene.yaml");
  const std::size_t from = text.find("levelling:"), to = text.find("geodetic_origin:");
  ASSERT_LT(from, to);
  text.erase(from, to - from);
  write_file_atomically(folder_ / "scene.yaml", [&](std::ostream& out) { out << text; });
  EXPECT_THAT(refusal(), HasSubstr("levelling"));  // Version 2 needs it.
  edit("version: 2", "version: 1");
  EXPECT_EQ(load_bundle(folder_).manifest.name, "test room");
  const BundleParts parts = load_bundle_parts(folder_);
  EXPECT_EQ(parts.version, 1);
  EXPECT_TRUE(parts.labels.name.empty());
  EXPECT_TRUE(parts.mesh_source.empty());
  EXPECT_EQ(parts.levelling.R_world_source, glm::dquat(1.0, 0.0, 0.0, 0.0));
}

TEST_F(SceneBundleTest, LevellingMustBeARotation) {
  edit("R_world_source_wxyz: [1, 0, 0, 0]", "R_world_source_wxyz: [2, 0, 0, 0]");
  EXPECT_THAT(refusal(), HasSubstr("expected a unit quaternion"));
  edit("R_world_source_wxyz: [2, 0, 0, 0]", "R_world_source_wxyz: [1, 0, 0]");
  EXPECT_THAT(refusal(), HasSubstr("expected 4 numbers, found 3"));
}

TEST_F(SceneBundleTest, UnknownKeyIsRefusedWithItsLine) {
  edit("name: test room", "nmae: test room\nname: x");
  EXPECT_THAT(refusal(), HasSubstr("scene.yaml:3"));
}

TEST_F(SceneBundleTest, InstanceOfAnUnlistedClassIsRefused) {
  edit("class: 1", "class: 9");
  EXPECT_THAT(refusal(), HasSubstr("expected a listed class, found 9"));
}

TEST_F(SceneBundleTest, BoxesAreOrderedAndInTheWorld) {
  edit("box_min_m: [0, 0, 0]", "box_min_m: [0, 2, 0]");
  EXPECT_THAT(refusal(), HasSubstr("expected box_min_m up to box_max_m, found 2 and 0.5"));
  edit("box_min_m: [0, 2, 0]", "box_min_m: [0, -1e300, 0]");
  EXPECT_THAT(refusal(), HasSubstr("expected numbers within 1e+07"));
}

TEST_F(SceneBundleTest, FilesInTheBundleAreRegular) {
  edit("name: surfels.ply", "name: /dev/zero");
  EXPECT_THAT(refusal(), HasSubstr("/dev/zero: expected a readable file"));
}

TEST_F(SceneBundleTest, NoManifestIsRefused) {
  fs::remove(folder_ / "scene.yaml");
  EXPECT_THAT(refusal(), HasSubstr("expected a scene bundle with scene.yaml"));
}

}  // namespace
}  // namespace segsim::core
