#include "reconstruction/evaluation/depth_repeatability.h"

#include <cmath>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>

#include "reconstruction/evaluation/image_quality.h"

namespace segsim::reconstruction {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

/// Depth of the wall x = 3 m, from the pixel rays in closed form.
core::Image<float> wall_depth(const core::CameraPose& T_world_camera,
                              const core::CameraIntrinsics& camera) {
  core::Image<float> depth_m(camera.width_px, camera.height_px, kNone);
  for (int y = 0; y < camera.height_px; ++y) {
    for (int x = 0; x < camera.width_px; ++x) {
      const glm::dvec3 ray =
          T_world_camera.rotation() * camera.back_project({x + 0.5, y + 0.5}, 1.0);
      const double z_m = (3.0 - T_world_camera.translation_m().x) / ray.x;
      if (z_m > 0.0) depth_m(x, y) = static_cast<float>(z_m);
    }
  }
  return depth_m;
}

TEST(DepthRepeatability, TheSameViewComesBackAsItWas) {
  const auto camera = core::CameraIntrinsics::from_fov(16, 12, 1.2);
  const core::CameraPose pose = core::look_at({0.3, -0.2, 1.0}, {3.0, 0.4, 1.2});
  core::Image<float> depth_m = wall_depth(pose, camera);
  depth_m(3, 4) = kNone;
  const core::Image<float> back = reprojected_depth(depth_m, camera, pose, pose);
  for (std::size_t i = 0; i < depth_m.size(); ++i) {
    if (std::isnan(depth_m.data()[i])) {
      EXPECT_TRUE(std::isnan(back.data()[i]));
    } else {
      EXPECT_NEAR(back.data()[i], depth_m.data()[i], 1e-5);
    }
  }
}

TEST(DepthRepeatability, AWallAgreesFromTwoPlacesAndAnErrorOfTheSensorShows) {
  const auto camera = core::CameraIntrinsics::from_fov(160, 120, 1.2);
  const core::CameraPose a = core::look_at({0.0, 0.0, 1.0}, {3.0, 0.0, 1.0});
  const core::CameraPose b = core::look_at({0.4, 0.3, 1.1}, {3.0, 0.2, 1.0});
  const core::Image<float> at_b_m = wall_depth(b, camera);
  DepthQuality exact;
  exact.add(reprojected_depth(wall_depth(a, camera), camera, a, b), at_b_m);
  // A point keeps its own depth but moves to the middle of its pixel: less than half a pixel
  // of the wall's slant, here 4 mm.
  EXPECT_GT(exact.completeness(), 0.5);
  EXPECT_LT(exact.mean_abs_m(), 0.004);

  core::Image<float> wrong_m = wall_depth(a, camera);
  for (float& z_m : wrong_m.pixels()) z_m += 0.05F;
  DepthQuality off;
  off.add(reprojected_depth(wrong_m, camera, a, b), at_b_m);
  EXPECT_NEAR(off.mean_abs_m(), 0.05, 0.005);
  EXPECT_NEAR(off.median_abs_m(), 0.05, 0.005);
}

TEST(DepthRepeatability, TheNearestPointOfAPixelWinsAndPointsBehindAreLeftOut) {
  const core::CameraIntrinsics camera{2, 1, 1.0, 1.0, 1.0, 0.5};
  // The points (-1, 0, 2) and (0.5, 0, 1).
  const core::CameraPose a, behind({1.0, 0.0, 0.0, 0.0}, {0.0, 0.0, 5.0});
  core::Image<float> depth_m(2, 1);
  depth_m.pixels() = {2.0F, 1.0F};
  const auto none = reprojected_depth(depth_m, camera, a, behind);
  EXPECT_TRUE(std::isnan(none(0, 0)) && std::isnan(none(1, 0)));

  // From 1.5 m to the left: columns 1 + 0.5 / 2 = 1.25 and 1 + 2 / 1 = 3.
  const core::CameraPose left({1.0, 0.0, 0.0, 0.0}, {-1.5, 0.0, 0.0});
  const auto moved = reprojected_depth(depth_m, camera, a, left);
  EXPECT_TRUE(std::isnan(moved(0, 0)));
  EXPECT_FLOAT_EQ(moved(1, 0), 2.0F);

  // From (0.6, 0, -1): columns 1 - 1.6 / 3 = 0.47 and 1 - 0.1 / 2 = 0.95, depths 3 and 2.
  const core::CameraPose both({1.0, 0.0, 0.0, 0.0}, {0.6, 0.0, -1.0});
  const auto one = reprojected_depth(depth_m, camera, a, both);
  EXPECT_FLOAT_EQ(one(0, 0), 2.0F);
  EXPECT_TRUE(std::isnan(one(1, 0)));
}

}  // namespace
}  // namespace segsim::reconstruction
