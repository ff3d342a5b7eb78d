#include "sim/sensors/render_validity.h"

#include <cmath>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>

namespace segsim::sim {
namespace {

core::CameraPose camera(const glm::dvec3& eye_m, const glm::dvec3& target_m) {
  return core::look_at(eye_m, target_m);
}

TEST(RenderValidity, CountsHoles) {
  core::Image<float> alpha(4, 2, 1.0F);
  alpha(0, 0) = 0.499F;
  alpha(1, 0) = 0.5F;
  alpha(2, 1) = 0.0F;
  alpha(3, 1) = 0.8F;
  const core::CameraPose pose = camera({0, 0, 1}, {1, 0, 1});
  const RenderValidity found = render_validity(alpha, pose, {}, 0.2);
  EXPECT_NEAR(found.mean_alpha, (4.0 + 0.499 + 0.5 + 0.8) / 8.0, 1e-7);
  EXPECT_EQ(found.hole_share, 0.25);
  EXPECT_TRUE(found.render_invalid);
  EXPECT_FALSE(render_validity(alpha, pose, {}, 0.25).render_invalid) << "above the limit";
  EXPECT_TRUE(std::isinf(found.view_m));
  EXPECT_TRUE(std::isinf(found.view_rad));
}

TEST(RenderValidity, NearestViewLooksTheSameWay) {
  const core::Image<float> alpha(2, 2, 1.0F);
  const core::CameraPose pose = camera({0, 0, 1}, {1, 0, 1});
  const std::vector<core::CameraPose> views = {
      camera({0.1, 0, 1}, {-1, 0, 1}),     // At the same place, backwards.
      camera({0, 0.8, 1}, {1, 0.8, 1}),    // The same way, 0.8 m beside.
      camera({0, -0.5, 1}, {1, -1.5, 1}),  // 0.5 m beside, 45 degrees off: 1.285.
  };
  const RenderValidity found = render_validity(alpha, pose, views, 0.2);
  EXPECT_NEAR(found.view_m, 0.8, 1e-12);
  EXPECT_NEAR(found.view_rad, 0.0, 1e-6);
  const RenderValidity of_two =
      render_validity(alpha, pose, std::vector{views[0], views[2]}, 0.2);
  EXPECT_NEAR(of_two.view_m, 0.5, 1e-12);
  EXPECT_NEAR(of_two.view_rad, 0.25 * std::numbers::pi, 1e-9);
}

TEST(RenderValidity, SummaryOfATrial) {
  std::vector<RenderValidity> images(4);
  for (int k = 0; k < 4; ++k) {
    RenderValidity& image = images[static_cast<std::size_t>(k)];
    image.mean_alpha = 1.0 - 0.1 * k;
    image.hole_share = 0.1 * k;
    image.view_m = k;
    image.view_rad = 0.5;
    image.render_invalid = k == 3;
  }
  const RenderValiditySummary found = summary_of(images);
  EXPECT_EQ(found.images, 4);
  EXPECT_EQ(found.invalid_images, 1);
  EXPECT_NEAR(found.mean_alpha, 0.85, 1e-12);
  EXPECT_NEAR(found.hole_share, 0.15, 1e-12);
  EXPECT_NEAR(found.view_m, 1.5, 1e-12);
  EXPECT_EQ(found.farthest_view_m, 3.0);
  EXPECT_NEAR(found.view_rad, 0.5, 1e-12);
  EXPECT_EQ(summary_of({}).images, 0);
  EXPECT_EQ(summary_of({}).mean_alpha, 0.0);
}

}  // namespace
}  // namespace segsim::sim
