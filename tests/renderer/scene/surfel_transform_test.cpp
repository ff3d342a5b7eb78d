#include "renderer/scene/surfel_transform.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "renderer/cpu_renderer.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::renderer {
namespace {

const glm::dquat kTurn = glm::angleAxis(0.8, glm::normalize(glm::dvec3(0.3, -0.5, 0.7)));
const glm::dvec3 kShift(0.4, -1.5, 2.0);

TEST(SurfelTransform, ACameraThatMovesAlongSeesTheSame) {
  auto cloud = std::make_shared<SurfelCloud>(testing::random_scene(5, 400));
  // Strong harmonics of all bands.
  cloud->sh_degree = 3;
  cloud->sh.clear();
  for (std::size_t i = 0; i < 16 * cloud->size(); ++i) {
    const auto x = static_cast<float>(i);
    cloud->sh.emplace_back(0.3F * std::sin(x), 0.3F * std::cos(1.7F * x),
                           0.3F * std::sin(2.3F * x + 1.0F));
  }
  auto moved = std::make_shared<SurfelCloud>(*cloud);
  transform_surfels(kTurn, kShift, *moved);
  const auto camera = core::CameraIntrinsics::from_fov(96, 72, 1.2);
  const core::CameraPose T_world_camera;
  const core::Transform<core::frame::World, core::frame::World> T_moved_world(kTurn, kShift);
  const core::Frame before =
      make_cpu_renderer(cloud)->render(T_world_camera, camera, core::Channels::kRgbd);
  const core::Frame after = make_cpu_renderer(moved)->render(T_moved_world * T_world_camera,
                                                             camera, core::Channels::kRgbd);
  int drawn = 0, different = 0;
  for (std::size_t k = 0; k < before.rgb.size(); ++k) {
    const core::Rgb8 a = before.rgb.pixels()[k], b = after.rgb.pixels()[k];
    drawn += before.alpha.pixels()[k] > 0.1F ? 1 : 0;
    // Rounding may move a surfel over a threshold of 1/255.
    different +=
        std::max({std::abs(a.r - b.r), std::abs(a.g - b.g), std::abs(a.b - b.b)}) > 2 ? 1 : 0;
  }
  EXPECT_GT(drawn, 1000);
  EXPECT_LT(different, drawn / 200);
}

TEST(SurfelTransform, HarmonicsKeepTheirEnergyAndComeBack) {
  SurfelCloud cloud = testing::random_scene(7, 20);
  const SurfelCloud before = cloud;
  transform_surfels(kTurn, kShift, cloud);
  transform_surfels(glm::conjugate(kTurn), -(glm::conjugate(kTurn) * kShift), cloud);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_LT(glm::length(cloud.position_m[i] - before.position_m[i]), 1e-5F);
    EXPECT_GT(std::abs(glm::dot(cloud.R_world_surfel[i], before.R_world_surfel[i])),
              1.0F - 1e-6F);
  }
  for (std::size_t k = 0; k < cloud.sh.size(); ++k) {
    EXPECT_LT(glm::length(cloud.sh[k] - before.sh[k]), 1e-5F);
  }
}

TEST(SurfelTransform, AModelMovesWithItsSurfels) {
  SurfelCloud cloud = testing::random_scene(5, 100);
  testing::add_random_features(cloud, 9);
  PanopticModel model = testing::random_model(2, 5, 20, 0.3F);
  const PanopticField before = fold_panoptic_model(cloud, model);
  transform_surfels(kTurn, kShift, cloud);
  transform_panoptic_model(kTurn, kShift, model);
  const PanopticField after = fold_panoptic_model(cloud, model);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_NEAR(before.instances.base(i), after.instances.base(i), 1e-5);
  }
}

}  // namespace
}  // namespace segsim::renderer
