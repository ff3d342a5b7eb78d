#include "worlds/capture/mesh_renderer.h"

#include <array>
#include <cmath>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/random.h"
#include "sim/ground/ray_scene.h"
#include "tests/worlds/mesh_fixtures.h"
#include "worlds/capture/irradiance_cache.h"
#include "worlds/capture/surface_shading.h"

namespace segsim::worlds {
namespace {

MeshRenderOptions quick(int threads = 1) {
  MeshRenderOptions options;
  options.threads = threads;
  options.shadow_samples = 4;
  options.bounce_samples = 16;
  options.cell_m = 0.1F;
  return options;
}

const core::CameraIntrinsics kCamera = core::CameraIntrinsics::from_fov(61, 43, 1.4);

TEST(RayScene, PacketsAgreeWithSingleRays) {
  const sim::RayScene rays(box_room(), 1);
  core::RandomStream random(3, "rays");
  const glm::vec3 origin(-0.4F, 0.7F, 1.1F);
  for (int packet = 0; packet < 200; ++packet) {
    std::array<glm::vec3, 8> directions;
    for (glm::vec3& d : directions) d = {random.normal(), random.normal(), random.normal()};
    const auto hits = rays.cast8(origin, directions);
    for (std::size_t i = 0; i < 8; ++i) {
      const sim::RayHit single = rays.cast(origin, directions[i]);
      ASSERT_EQ(hits[i].mesh, single.mesh);
      ASSERT_EQ(hits[i].triangle, single.triangle);
      ASSERT_NEAR(hits[i].t, single.t, 1e-4F * single.t);
      ASSERT_LT(glm::distance(hits[i].normal, single.normal), 1e-5F);
    }
  }
}

TEST(RayScene, OcclusionRespectsTheSegment) {
  const sim::RayScene rays(box_room(), 1);
  EXPECT_FALSE(rays.occluded({0, 0, 1}, {0, 0, -1}, 0.0F, 0.99F));
  EXPECT_TRUE(rays.occluded({0, 0, 1}, {0, 0, -1}, 0.0F, 1.01F));
  EXPECT_FALSE(rays.cast({0, 0, 1}, {0, 0, -1}, 0.0F, 0.99F).hit());
}

TEST(RayScene, ATriangleWithAnUnknownVertexIsRefused) {
  sim::MeshScene scene = box_room();
  scene.meshes[0].triangles[0].y = 4;
  EXPECT_THROW(sim::RayScene(scene, 1), core::ContractViolation);
}

TEST(SurfaceShading, TexturesAreReadWithRowZeroOnTop) {
  sim::MeshScene scene = box_room();
  core::Image<core::Rgb8> texture(2, 2);
  texture(0, 0) = {255, 0, 0};  // top left: u = 0.25, v = 0.75
  texture(1, 1) = {0, 0, 255};  // bottom right: u = 0.75, v = 0.25
  scene.textures = {texture};
  scene.materials[0] = {glm::vec3(0.5F), 0, {}};
  const sim::RayScene rays(scene, 1);
  const SurfaceShading surfaces(scene);
  // On the floor, u grows with x and v with y, over 4 m.
  const sim::RayHit top_left = rays.cast({-1, 1, 1}, {0, 0, -1});
  const sim::RayHit bottom_right = rays.cast({1, -1, 1}, {0, 0, -1});
  EXPECT_LT(glm::distance(surfaces.albedo(top_left, 0.0F), glm::vec3(0.5F, 0, 0)), 1e-4F);
  EXPECT_LT(glm::distance(surfaces.albedo(bottom_right, 0.0F), glm::vec3(0, 0, 0.5F)), 1e-4F);
  // Averaged over the whole floor: a quarter of each, in linear light.
  EXPECT_LT(glm::distance(surfaces.albedo(top_left, 10.0F), glm::vec3(0.125F, 0, 0.125F)),
            0.01F);
}

TEST(SurfaceShading, ColourConversionIsThatOfSrgb) {
  EXPECT_EQ(srgb_from_linear({0, 0.5F, 1}), (core::Rgb8{0, 188, 255}));
  EXPECT_EQ(srgb_from_linear({-1, 2, std::nanf("")}), (core::Rgb8{0, 255, 0}));
}

TEST(IrradianceCache, OneLampAboveAFloorFollowsTheInverseSquareLaw) {
  sim::MeshScene scene;
  scene.materials.resize(1);
  add_rectangle(scene, {-3, -3, 0}, {6, 0, 0}, {0, 6, 0}, 0, 1, 0);
  scene.lights.push_back({{0, 0, 2}, glm::vec3(3, 2, 1), 0.1F});
  const sim::RayScene rays(scene, 1);
  const SurfaceShading surfaces(scene);
  const IrradianceCache light(scene, rays, surfaces, {0.05F, 4, 4});
  const glm::vec3 up(0, 0, 1);
  for (const float x : {0.0F, 0.5F, 1.0F, 2.0F}) {
    const float distance2 = x * x + 4;
    const float expected = 3 * (2 / std::sqrt(distance2)) / (distance2 + 0.15F);
    const glm::vec3 found = light.at({x, 0, 0}, up, up);
    EXPECT_NEAR(found.x, expected, 0.01F * expected) << x;
    EXPECT_NEAR(found.z, expected / 3, 0.01F * expected) << x;
  }
}

TEST(IrradianceCache, AnOpaqueLidCastsAShadow) {
  sim::MeshScene scene;
  scene.materials.resize(1);
  add_rectangle(scene, {-3, -3, 0}, {6, 0, 0}, {0, 6, 0}, 0, 1, 0);
  add_rectangle(scene, {-0.5, -0.5, 1}, {1, 0, 0}, {0, 1, 0}, 0, 1, 0);
  scene.lights.push_back({{0, 0, 2}, glm::vec3(3), 0.05F});
  const sim::RayScene rays(scene, 1);
  const SurfaceShading surfaces(scene);
  const IrradianceCache light(scene, rays, surfaces, {0.05F, 8, 64});
  const glm::vec3 up(0, 0, 1);
  EXPECT_LT(light.at({0, 0, 0}, up, up).x, 0.5F * light.at({1.5F, 0, 0}, up, up).x);
}

TEST(MeshRenderer, DepthOfAPlaneIsExact) {
  const auto renderer = make_mesh_renderer(box_room(), quick());
  // Looks along -x at the wall x = -2 from x = 0.5, level: every wall pixel is 2.5 m deep.
  const core::CameraPose pose = core::look_at({0.5, 0, 1.2}, {-1, 0, 1.2});
  const core::Frame frame = renderer->render(pose, kCamera, core::Channels::kAll);
  int wall_pixels = 0;
  for (int y = 0; y < 43; ++y) {
    for (int x = 0; x < 61; ++x) {
      ASSERT_EQ(frame.alpha(x, y), 1.0F);
      ASSERT_EQ(frame.confidence(x, y), 1.0F);
      const glm::dvec3 p =
          (pose * core::Point<core::frame::Camera>{kCamera.back_project(
                      {x + 0.5, y + 0.5}, static_cast<double>(frame.depth_m(x, y)))})
              .xyz_m;
      // Every back-projected pixel lies on a side of the room.
      const double off = std::min({std::abs(std::abs(p.x) - 2), std::abs(std::abs(p.y) - 2),
                                   std::abs(p.z), std::abs(p.z - 2.5)});
      ASSERT_LT(off, 1e-5);
      if (std::abs(p.x + 2) < 1e-4) {
        ++wall_pixels;
        ASSERT_NEAR(frame.depth_m(x, y), 2.5F, 1e-5F);
        ASSERT_EQ(frame.semantic(x, y), 1);
        ASSERT_EQ(frame.instance(x, y), 0);
        ASSERT_LT(glm::distance(frame.normal(x, y), glm::vec3(1, 0, 0)), 1e-5F);
      }
    }
  }
  EXPECT_GT(wall_pixels, 500);
}

TEST(MeshRenderer, LabelsAndNormalsOfAThing) {
  const auto renderer = make_mesh_renderer(box_room(), quick());
  const core::CameraPose pose = core::look_at({-1, 0, 0.25}, {1, 0, 0.25});
  const core::Frame frame = renderer->render(pose, kCamera, core::Channels::kAll);
  EXPECT_EQ(frame.semantic(30, 21), 4);
  EXPECT_EQ(frame.instance(30, 21), 1);
  EXPECT_NEAR(frame.depth_m(30, 21), 1.75F, 1e-5F);
  EXPECT_LT(glm::distance(frame.normal(30, 21), glm::vec3(-1, 0, 0)), 1e-5F);
  const core::Rgb8 red = frame.rgb(30, 21);
  EXPECT_GT(red.r, 2 * red.g) << "the chair is red";
}

TEST(MeshRenderer, WhatIsNotHitIsNotMeasured) {
  sim::MeshScene scene;
  scene.materials.resize(1);
  add_rectangle(scene, {-1, -1, 0}, {2, 0, 0}, {0, 2, 0}, 0, 1, 0);
  const auto renderer = make_mesh_renderer(scene, quick());
  const core::Frame frame =
      renderer->render(core::look_at({0, 0, 1}, {1, 0, 1.5}), kCamera, core::Channels::kAll);
  EXPECT_EQ(frame.alpha(30, 5), 0.0F);
  EXPECT_TRUE(std::isnan(frame.depth_m(30, 5)));
  EXPECT_EQ(frame.semantic(30, 5), 0);
  EXPECT_EQ(frame.confidence(30, 5), 0.0F);
  EXPECT_EQ(frame.normal(30, 5), glm::vec3(0));
}

TEST(MeshRenderer, OnlyWhatIsAskedForIsMade) {
  const auto renderer = make_mesh_renderer(box_room(), quick());
  const core::Frame frame =
      renderer->render(core::look_at({0, 0, 1}, {1, 0, 1}), kCamera, core::Channels::kDepth);
  EXPECT_TRUE(frame.rgb.empty());
  EXPECT_TRUE(frame.normal.empty());
  EXPECT_TRUE(frame.semantic.empty());
  EXPECT_EQ(frame.depth_m.width_px(), 61);
  EXPECT_EQ(frame.alpha.height_px(), 43);
}

TEST(MeshRenderer, ColourDependsNeitherOnThreadsNorOnEarlierFrames) {
  const core::CameraPose first = core::look_at({-1, -1, 1.2}, {1, 1, 0.5});
  const core::CameraPose second = core::look_at({1.5, 1.2, 1.0}, {-1, 0, 1});
  const auto alone = make_mesh_renderer(box_room(), quick(1));
  const auto crowd = make_mesh_renderer(box_room(), quick(2));
  const core::Frame wanted = alone->render(second, kCamera, core::Channels::kRgb);
  (void)crowd->render(first, kCamera, core::Channels::kRgb);
  const core::Frame found = crowd->render(second, kCamera, core::Channels::kRgb);
  EXPECT_EQ(wanted.rgb.pixels(), found.rgb.pixels());
}

TEST(MeshRenderer, TheSameWallPointHasTheSameColourFromTwoSides) {
  const auto renderer = make_mesh_renderer(box_room(), quick());
  const glm::dvec3 target(-2, 0.3, 1.3);
  const core::Frame left =
      renderer->render(core::look_at({0, 1.2, 1.0}, target), kCamera, core::Channels::kRgb);
  const core::Frame right =
      renderer->render(core::look_at({0.2, -1, 1.5}, target), kCamera, core::Channels::kRgb);
  const core::Rgb8 a = left.rgb(30, 21);
  const core::Rgb8 b = right.rgb(30, 21);
  EXPECT_NEAR(a.r, b.r, 3);
  EXPECT_NEAR(a.g, b.g, 3);
  EXPECT_GT(a.r, 80) << "exposure is chosen so that walls are bright";
  EXPECT_LT(a.r, 250);
}

TEST(MeshRenderer, AMissingMaterialIsRefused) {
  sim::MeshScene scene = box_room();
  scene.meshes[2].material = 7;
  EXPECT_THROW((void)make_mesh_renderer(scene, quick()), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::worlds
