// Worlds for Gazebo: accepted by libsdformat and by `ign sdf --check`, and meaning what the
// robot's profile and the bundle say.

#include "sim/gazebo/gazebo_world.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <set>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ignition/math/SphericalCoordinates.hh>
#include <sdf/sdf.hh>

#include "core/file_io.h"
#include "sim/gazebo/gazebo_cameras.h"
#include "sim/ground/geodesy.h"
#include "sim/ground/world.h"
#include "tests/box_mesh.h"
#include "tests/error_message.h"
#include "worlds/mesh/mesh_import.h"
#include "worlds/mesh/plain_mesh.h"
#include "worlds/surface/bundle_files.h"

namespace segsim::sim {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

class GazeboWorld : public ::testing::Test {
 protected:
  GazeboWorld()
      : folder_(fs::temp_directory_path() /
                ("segsim_gazebo_world_" + std::to_string(::getpid()))) {
    fs::remove_all(folder_);
    fs::create_directories(folder_ / "bundle");
    append_floor(mesh_, -3, -2, 3, 2);
    append_box(mesh_, {-3.2F, -2.2F, 0}, {-3, 2.2F, 2});
    append_box(mesh_, {3, -2.2F, 0}, {3.2F, 2.2F, 2});
    append_box(mesh_, {-3, -2.2F, 0}, {3, -2, 2});
    append_box(mesh_, {-3, 2, 0}, {3, 2.2F, 2});
    append_box(mesh_, {-3, -2, 0}, {-1.5F, 2, 1});  // What is left has its middle at x = 0.75.
    core::SceneManifest manifest;
    manifest.name = "my lab-2";
    manifest.created_by = manifest.source = "test";
    manifest.camera_height_m = 0.8;
    manifest.origin = {49.9, 8.9, 120.0, 0.6};
    manifest.classes = {{1, "floor", false}};
    manifest.surfels.name = "surfels.ply";
    core::write_file_atomically(folder_ / "bundle" / "surfels.ply",
                                [](std::ostream& out) { out << "not read here"; });
    worlds::write_collision_files(folder_ / "bundle", mesh_, RobotModel::jackal_gentle(),
                                  manifest);
    core::write_bundle_manifest(folder_ / "bundle", manifest);
    bundle_ = core::load_bundle(folder_ / "bundle");
  }
  ~GazeboWorld() override { fs::remove_all(folder_); }

  fs::path folder_;
  TriangleMesh mesh_;
  core::SceneBundle bundle_;
};

/// Messages of the parser with every policy at its strictest.
std::vector<std::string> strict_errors(const fs::path& file) {
  sdf::ParserConfig config;
  config.SetWarningsPolicy(sdf::EnforcementPolicy::ERR);
  config.SetUnrecognizedElementsPolicy(sdf::EnforcementPolicy::ERR);
  config.SetDeprecatedElementsPolicy(sdf::EnforcementPolicy::ERR);
  sdf::Root root;
  std::vector<std::string> messages;
  for (const sdf::Error& error : root.Load(file.string(), config)) {
    messages.push_back(error.Message());
  }
  return messages;
}

TEST_F(GazeboWorld, GazebosParserHasNothingToComplainAbout) {
  for (const auto flavour : {GazeboFlavour::kIgnition, GazeboFlavour::kGz}) {
    GazeboWorldOptions options;
    options.flavour = flavour;
    const fs::path out = folder_ / "out";
    export_gazebo_world(bundle_, out, options);
    EXPECT_THAT(strict_errors(out / "world.sdf"), IsEmpty());
    EXPECT_THAT(strict_errors(out / "models" / "jackal" / "model.sdf"), IsEmpty());
    EXPECT_THAT(
        core::read_file(out / "world.sdf"),
        HasSubstr(flavour == GazeboFlavour::kGz
                      ? "\"gz-sim-diff-drive-system\" name=\"gz::sim::systems::DiffDrive"
                      : "\"ignition-gazebo-diff-drive-system\" "
                        "name=\"ignition::gazebo::systems::DiffDrive"));
  }
}

TEST_F(GazeboWorld, GazebosOwnCheckerAcceptsIt) {
  if (std::system("command -v ign >/dev/null") != 0) GTEST_SKIP() << "ignition-tools";
  export_gazebo_world(bundle_, folder_ / "out", {});
  for (const char* file : {"world.sdf", "models/jackal/model.sdf"}) {
    const std::string command =
        "ign sdf --check " + (folder_ / "out" / file).string() + " 2>/dev/null";
    FILE* pipe = ::popen(command.c_str(), "r");
    ASSERT_NE(pipe, nullptr);
    std::array<char, 256> line{};
    std::string output;
    while (std::fgets(line.data(), line.size(), pipe) != nullptr) output += line.data();
    EXPECT_EQ(::pclose(pipe), 0) << file;
    EXPECT_THAT(output, HasSubstr("Valid.")) << file;
  }
}

TEST_F(GazeboWorld, TheRobotHasTheProfilesSizeMassAndDrive) {
  const fs::path out = folder_ / "out";
  GazeboWorldOptions options;
  options.start = {0.5, -0.25, 1.0};
  export_gazebo_world(bundle_, out, options);
  sdf::Root root;
  ASSERT_THAT(root.Load((out / "world.sdf").string()), IsEmpty());
  const sdf::World* world = root.WorldByIndex(0);
  ASSERT_NE(world, nullptr);
  EXPECT_EQ(world->Name(), "my_lab_2");
  const sdf::Model* jackal = world->ModelByName("jackal");
  ASSERT_NE(jackal, nullptr);
  EXPECT_NEAR(jackal->RawPose().X(), 0.5, 1e-9);
  EXPECT_NEAR(jackal->RawPose().Rot().Yaw(), 1.0, 1e-9);

  const RobotModel robot = RobotModel::jackal_gentle();
  double mass_kg = 0.0, left_m = -1.0, right_m = 1.0, front_m = -1.0;
  for (std::uint64_t i = 0; i < jackal->LinkCount(); ++i) {
    const sdf::Link& link = *jackal->LinkByIndex(i);
    mass_kg += link.Inertial().MassMatrix().Mass();
    EXPECT_TRUE(link.Inertial().MassMatrix().IsValid()) << link.Name();
    if (link.Name() == "base_link") continue;
    ignition::math::Pose3d pose;
    ASSERT_THAT(link.SemanticPose().Resolve(pose, "__model__"), IsEmpty());
    // Wheels stand on the floor, upright, and turn about the axle that points left.
    EXPECT_NEAR(pose.Z(), robot.wheel_radius_m, 1e-6) << link.Name();
    EXPECT_NEAR(pose.Rot().RotateVector(ignition::math::Vector3d::UnitZ).Y(), 1.0, 1e-9);
    left_m = std::max(left_m, pose.Y());
    right_m = std::min(right_m, pose.Y());
    front_m = std::max(front_m, pose.X());
    const sdf::Cylinder* shape = link.CollisionByIndex(0)->Geom()->CylinderShape();
    ASSERT_NE(shape, nullptr);
    EXPECT_NEAR(shape->Radius(), robot.wheel_radius_m, 1e-9);
    // Outer size of the base, up to the fenders of the data sheet.
    EXPECT_LE(pose.Y() + 0.5 * shape->Length(), 0.5 * robot.width_m);
    EXPECT_LE(pose.X() + shape->Radius(), 0.5 * robot.length_m);
  }
  EXPECT_NEAR(mass_kg, 17.0, 1e-6);
  EXPECT_NEAR(left_m - right_m, robot.track_m, 1e-6);
  EXPECT_NEAR(front_m, 0.131, 1e-6);
  const sdf::Box* chassis = jackal->LinkByName("base_link")
                                ->CollisionByName("chassis_collision")
                                ->Geom()
                                ->BoxShape();
  ASSERT_NE(chassis, nullptr);
  EXPECT_EQ(chassis->Size(), ignition::math::Vector3d(0.42, 0.31, 0.184));
  EXPECT_THAT(core::read_file(out / "world.sdf"),
              HasSubstr("<wheel_separation>0.563385</wheel_separation>"));  // 1.5 x 0.37559
}

TEST_F(GazeboWorld, ItsCamerasAreReadBackAsTheyWereMeant) {
  GazeboWorldOptions options;
  options.camera_height_m = 0.8;
  options.camera_pitch_down_rad = 0.2;
  options.width_px = 320;
  options.height_px = 240;
  options.horizontal_fov_rad = 1.1;
  options.rate_hz = 12.5;
  options.start = {1.0, 0.5, 0.3};
  export_gazebo_world(bundle_, folder_ / "out", options);
  const GazeboCameras found = read_gazebo_cameras(folder_ / "out" / "world.sdf");
  EXPECT_THAT(found.warnings, IsEmpty());
  ASSERT_THAT(found.cameras, SizeIs(2));
  EXPECT_EQ(found.cameras[0].rgb_topic, "/camera/image");
  EXPECT_EQ(found.cameras[1].labels_topic, "/panoptic/labels_map");
  EXPECT_EQ(found.cameras[1].labels, GazeboLabels::kPanoptic);
  const auto intrinsics = core::CameraIntrinsics::from_fov(320, 240, 1.1);
  const auto T_robot_camera = core::mast_camera(0.8, 0.2);
  for (const GazeboCamera& camera : found.cameras) {
    EXPECT_EQ(camera.rate_hz, 12.5);
    EXPECT_EQ(camera.intrinsics.fx_px, intrinsics.fx_px);
    // base_link lies straight above the model's origin.
    const glm::dvec3 p = camera.T_link_camera.translation_m();
    EXPECT_NEAR(p.x, T_robot_camera.translation_m().x, 1e-12);
    EXPECT_NEAR(p.z + 0.0635, T_robot_camera.translation_m().z, 1e-12);
    EXPECT_NEAR(std::abs(glm::dot(camera.T_link_camera.rotation(), T_robot_camera.rotation())),
                1.0, 1e-12);
  }
}

TEST_F(GazeboWorld, TheMeshKeepsItsShapeAndAxes) {
  export_gazebo_world(bundle_, folder_ / "out", {});
  worlds::MeshFileOptions as_it_is;
  as_it_is.up = worlds::UpAxis::kZ;
  as_it_is.add_lights = false;
  const TriangleMesh back = worlds::plain_mesh(
      worlds::load_mesh_file(folder_ / "out" / "meshes" / "collision.obj", as_it_is));
  const TriangleMesh truth = read_mesh_ply(bundle_.collision_mesh_file());
  ASSERT_EQ(back.triangles.size(), truth.triangles.size());
  // The same triangles in the same order, whatever the numbering of their corners.
  for (std::size_t i = 0; i < truth.triangles.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      const glm::vec3 a = truth.positions_m[truth.triangles[i][k]];
      const glm::vec3 b = back.positions_m[back.triangles[i][k]];
      ASSERT_NEAR(a.x, b.x, 1e-5);
      ASSERT_NEAR(a.y, b.y, 1e-5);
      ASSERT_NEAR(a.z, b.z, 1e-5);
    }
  }
}

TEST_F(GazeboWorld, TheOriginOnTheEarthIsOurs) {
  export_gazebo_world(bundle_, folder_ / "out", {});
  sdf::Root root;
  ASSERT_THAT(root.Load((folder_ / "out" / "world.sdf").string()), IsEmpty());
  const ignition::math::SphericalCoordinates* gazebo =
      root.WorldByIndex(0)->SphericalCoordinates();
  ASSERT_NE(gazebo, nullptr);
  const LocalFrame ours(bundle_.manifest.origin);
  using Spherical = ignition::math::SphericalCoordinates;
  const auto there =
      gazebo->PositionTransform({12.0, -7.0, 1.5}, Spherical::LOCAL2, Spherical::SPHERICAL);
  const GeodeticPoint here = ours.to_geodetic({12.0, -7.0, 1.5});
  EXPECT_NEAR(there.X() * 180.0 / std::numbers::pi, here.latitude_deg, 1e-9);  // 0.1 mm
  EXPECT_NEAR(there.Y() * 180.0 / std::numbers::pi, here.longitude_deg, 1e-9);
  EXPECT_NEAR(there.Z(), here.height_m, 1e-3);
}

TEST_F(GazeboWorld, TheRobotStartsWhereThereIsRoom) {
  const core::Pose2 start = roomiest_start(bundle_, RobotModel::jackal_gentle());
  // The free floor is 4.5 m x 4 m; its middle line lies at y = 0.
  EXPECT_NEAR(start.y_m, 0.0, 0.15);
  EXPECT_GT(start.x_m, 0.3);
  EXPECT_LT(start.x_m, 1.2);
}

TEST_F(GazeboWorld, BadInputIsOneLine) {
  EXPECT_THAT(tests::input_error_of([&] { write_mesh_obj(folder_ / "empty.obj", {}); }),
              HasSubstr("expected a mesh with triangles"));
  core::write_file_atomically(folder_ / "file", [](std::ostream& out) { out << "a file"; });
  EXPECT_THAT(
      tests::input_error_of([&] { export_gazebo_world(bundle_, folder_ / "file", {}); }),
      HasSubstr("file"));
}

}  // namespace
}  // namespace segsim::sim
