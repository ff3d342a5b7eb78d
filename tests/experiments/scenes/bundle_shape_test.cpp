#include "experiments/scenes/bundle_shape.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "experiments/scenes/mesh_accuracy.h"
#include "renderer/cpu_renderer.h"
#include "renderer/scene/surfel_transform.h"
#include "tests/experiments/surfel_room.h"

namespace segsim::experiments {
namespace {

using ::testing::HasSubstr;

const core::CameraIntrinsics kCamera =
    core::CameraIntrinsics::from_fov(160, 120, std::numbers::pi / 2.0);

scenes::SceneShape fused_room(const glm::dquat& R, const glm::dvec3& t_m) {
  auto surfels = std::make_shared<renderer::SurfelCloud>(surfel_room());
  renderer::transform_surfels(R, t_m, *surfels);
  const core::Transform<core::frame::World, core::frame::World> T_moved_room(R, t_m);
  std::vector<core::CameraPose> poses = room_views();
  for (core::CameraPose& pose : poses) pose = T_moved_room * pose;
  const auto renderer = renderer::make_cpu_renderer(surfels);
  return scenes::fuse_rendered_depth(*renderer, kCamera, poses, {});
}

double statistic(const scenes::SceneShape& shape, const std::string& name) {
  for (const auto& [key, value] : shape.statistics) {
    if (key == name) return value;
  }
  return std::nan("");
}

TEST(BundleShape, RenderedDepthOfARoomIsTheRoom) {
  scenes::SceneShape shape = fused_room({1, 0, 0, 0}, {});
  EXPECT_EQ(shape.source, "fused depth of 24 rendered views");
  EXPECT_EQ(shape.camera_positions_m.size(), 24U);
  EXPECT_LT(statistic(shape, "surface_open_edge_share"), 0.05);
  const std::size_t before = shape.surface.triangles.size();
  scenes::decimate_shape(shape, 0.01);
  EXPECT_LT(shape.surface.triangles.size(), before / 3);
  const auto robot = sim::RobotModel::jackal_gentle();
  const sim::TriangleMesh made =
      worlds::collision_mesh_of_surface(shape.surface, shape.camera_positions_m).mesh;
  const scenes::MeshAccuracy accuracy = scenes::mesh_accuracy(made, room_triangles(), robot);
  EXPECT_LT(accuracy.mean_m, 0.01);
  EXPECT_LT(accuracy.percentile95_m, 0.02);
  EXPECT_GT(accuracy.free_truth, 1000U);
  EXPECT_GT(accuracy.free_agreement(), 0.9);
  EXPECT_THAT(accuracy.text(), HasSubstr("agree"));
}

TEST(BundleShape, ATiltedRoomIsLevelled) {
  const glm::dquat R = glm::angleAxis(0.02, glm::normalize(glm::dvec3(1.0, -0.3, 0.0)));
  const glm::dvec3 t_m(0.0, 0.0, 0.06);
  scenes::SceneShape shape = fused_room(R, t_m);
  const glm::dvec3 camera_m = shape.camera_positions_m.front();
  const core::SceneLevelling levelling = scenes::level_shape(shape);
  EXPECT_EQ(statistic(shape, "levelled"), 1.0);
  EXPECT_NEAR(statistic(shape, "levelled_from_tilt_rad"), 0.02, 0.002);
  EXPECT_NEAR(statistic(shape, "levelled_from_height_m"), 0.06, 0.005);
  for (const glm::dvec3& corner : {glm::dvec3(-2, -1.5, 0), {2, 1.5, 0}, {2, -1.5, 0}}) {
    const glm::dvec3 p =
        levelling.R_world_source * (R * corner + t_m) + levelling.p_world_source_m;
    EXPECT_NEAR(p.z, 0.0, 0.005);
  }
  const glm::dvec3 moved = levelling.R_world_source * camera_m + levelling.p_world_source_m;
  EXPECT_LT(glm::distance(shape.camera_positions_m.front(), moved), 1e-9);
  // Once is enough.
  const core::SceneLevelling again = scenes::level_shape(shape);
  EXPECT_EQ(again.R_world_source, glm::dquat(1, 0, 0, 0));
}

TEST(BundleShape, PointsAreLevelledToo) {
  const renderer::SurfelCloud room = surfel_room();
  scenes::SceneShape shape;
  for (std::size_t i = 0; i < room.size(); ++i) {
    shape.points_m.push_back(room.position_m[i] + glm::vec3(0, 0, 0.1F));
    shape.normals.push_back(room.R_world_surfel[i] * glm::vec3(0, 0, 1));
  }
  const core::SceneLevelling levelling = scenes::level_shape(shape);
  EXPECT_NEAR(levelling.p_world_source_m.z, -0.1, 1e-3);
  EXPECT_NEAR(shape.points_m.front().z, 0.0F, 1e-3F);
  scenes::decimate_shape(shape, 0.01);  // There is no surface.
  EXPECT_TRUE(shape.surface.triangles.empty());
}

TEST(BundleShape, NothingSeenGivesNoMesh) {
  auto none = std::make_shared<renderer::SurfelCloud>(surfel_room());
  const auto renderer = renderer::make_cpu_renderer(none);
  // Looks away from everything.
  const std::vector<core::CameraPose> away = {core::look_at({10, 0, 1}, {11, 0, 1})};
  scenes::SceneShape shape = scenes::fuse_rendered_depth(*renderer, kCamera, away, {});
  EXPECT_TRUE(shape.surface.triangles.empty());
  const core::SceneLevelling levelling = scenes::level_shape(shape);
  EXPECT_EQ(levelling.p_world_source_m, glm::dvec3(0.0));
}

TEST(BundleShape, SourcesHaveNames) {
  EXPECT_EQ(scenes::parse_mesh_source("auto", "--mesh"), scenes::MeshSource::kAuto);
  EXPECT_EQ(scenes::parse_mesh_source("lifted", "--mesh"), scenes::MeshSource::kLifted);
  EXPECT_EQ(scenes::parse_mesh_source("depth", "--mesh"), scenes::MeshSource::kDepth);
  EXPECT_THROW((void)scenes::parse_mesh_source("poisson", "--mesh"), core::InputError);
}

TEST(MeshAccuracy, AShiftIsMeasured) {
  const sim::TriangleMesh truth = room_triangles();
  const auto robot = sim::RobotModel::jackal_gentle();
  const scenes::MeshAccuracy same = scenes::mesh_accuracy(truth, truth, robot);
  EXPECT_LT(same.percentile95_m, 1e-5);
  EXPECT_EQ(same.free_agreement(), 1.0);
  EXPECT_EQ(same.free_missed(), 0.0);
  EXPECT_EQ(same.free_invented(), 0.0);
  sim::TriangleMesh shifted = truth;
  for (glm::vec3& p : shifted.positions_m) p += glm::vec3(0.05F, 0.0F, 0.0F);
  const scenes::MeshAccuracy moved = scenes::mesh_accuracy(shifted, truth, robot);
  EXPECT_NEAR(moved.percentile95_m, 0.05, 1e-3);
  EXPECT_GT(moved.mean_m, 0.005);
  EXPECT_LT(moved.free_agreement(), 1.0);
  EXPECT_GT(moved.free_missed(), 0.0);
  EXPECT_GT(moved.free_invented(), 0.0);
  const core::MeasurementRecord record = moved.record("shifted");
  ASSERT_EQ(record.values.size(), 6U);
  EXPECT_EQ(record.values[0].case_name, "shifted");
  EXPECT_EQ(record.values[0].unit, "mm");
  EXPECT_DOUBLE_EQ(record.values[0].value, 1000.0 * moved.mean_m);
  EXPECT_THROW((void)scenes::mesh_accuracy(sim::TriangleMesh{}, truth, robot),
               core::InputError);
}

}  // namespace
}  // namespace segsim::experiments
