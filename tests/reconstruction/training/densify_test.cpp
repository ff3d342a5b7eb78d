#include "reconstruction/training/densify.h"

#include <cmath>

#include <gmock/gmock.h>

#include "core/check.h"
#include "reconstruction/training/raw_surfels.h"

namespace segsim::reconstruction {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

SurfelStatistics plain(std::size_t count) {
  SurfelStatistics s;
  s.gradient.assign(count, 0.0F);
  s.max_weight.assign(count, 1.0F);
  s.opacity.assign(count, 0.9F);
  s.long_scale_m.assign(count, 0.02F);
  s.short_scale_m.assign(count, 0.01F);
  return s;
}

GeometryConfig::Densify config() {
  GeometryConfig::Densify c;
  c.min_gradient = 1.0;
  c.max_growth = 0.5;
  c.max_surfels = 100;
  return c;
}

TEST(Split, StrongestWithinGrowthAndBudget) {
  SurfelStatistics s = plain(6);
  s.gradient = {2.0F, 0.5F, 5.0F, 3.0F, 3.0F, 3.0F};
  GeometryConfig::Densify c = config();
  EXPECT_THAT(surfels_to_split(s, c), ElementsAre(2, 3, 4));  // Ties: the lower index.
  c.max_surfels = 8;
  EXPECT_THAT(surfels_to_split(s, c), ElementsAre(2, 3));
  c.max_surfels = 5;
  EXPECT_THAT(surfels_to_split(s, c), IsEmpty());
  c.max_surfels = 100;
  c.max_growth = 1.0;
  EXPECT_THAT(surfels_to_split(s, c), ElementsAre(0, 2, 3, 4, 5));
  s.long_scale_m[2] = 0.001F;  // Too small to be halved.
  EXPECT_THAT(surfels_to_split(s, c), ElementsAre(0, 3, 4, 5));
}

TEST(Keep, OpaqueNeededAndOfReasonableSize) {
  SurfelStatistics s = plain(5);
  s.opacity[0] = 0.04F;
  s.max_weight[1] = 0.005F;
  s.long_scale_m[2] = 0.5F;  // Of an extent of 4 m: more than a tenth.
  EXPECT_THAT(surfels_to_keep(s, config(), 4.0), ElementsAre(3, 4));
  EXPECT_THAT(surfels_to_keep(s, config(), 6.0), ElementsAre(2, 3, 4));
}

TEST(Keep, RefusesListsOfOtherLengths) {
  SurfelStatistics s = plain(3);
  s.opacity.pop_back();
  EXPECT_THROW((void)surfels_to_keep(s, config(), 1.0), core::ContractViolation);
}

/// Turned by 90 degrees about z: t_u = y.
renderer::SurfelCloud one_surfel() {
  renderer::SurfelCloud cloud;
  cloud.position_m = {{1.0F, 2.0F, 3.0F}};
  cloud.R_world_surfel = {glm::angleAxis(0.5F * 3.14159265F, glm::vec3(0.0F, 0.0F, 1.0F))};
  cloud.scale_m = {{0.1F, 0.02F}};
  cloud.opacity = {0.8F};
  cloud.sh = {{0.1F, 0.2F, 0.3F}};
  return cloud;
}

TEST(SplitSurfels, HalvesAlongTheLongerAxis) {
  RawSurfels first = raw_surfels(one_surfel(), 0);
  const RawSurfels second = split_surfels(first);
  const renderer::SurfelCloud a = surfel_cloud(first), b = surfel_cloud(second);
  EXPECT_NEAR(a.position_m[0].y, 2.06F, 1e-5F);
  EXPECT_NEAR(b.position_m[0].y, 1.94F, 1e-5F);
  EXPECT_NEAR(a.position_m[0].x, 1.0F, 1e-5F);
  for (const renderer::SurfelCloud& half : {a, b}) {
    EXPECT_NEAR(half.scale_m[0].x, 0.07F, 1e-5F);
    EXPECT_NEAR(half.scale_m[0].y, 0.018F, 1e-5F);
    EXPECT_NEAR(half.opacity[0], 0.8F, 1e-5F);
    EXPECT_EQ(half.sh[0], one_surfel().sh[0]);
  }
}

TEST(RawSurfels, ThereAndBack) {
  renderer::SurfelCloud cloud = one_surfel();
  cloud.sh_degree = 1;
  cloud.sh.resize(4, {0.5F, 0.25F, 0.125F});
  const renderer::SurfelCloud back = surfel_cloud(raw_surfels(cloud, 1));
  EXPECT_EQ(back.position_m, cloud.position_m);
  EXPECT_EQ(back.sh, cloud.sh);
  EXPECT_NEAR(back.scale_m[0].y, cloud.scale_m[0].y, 1e-7F);
  EXPECT_NEAR(back.opacity[0], cloud.opacity[0], 1e-6F);
  EXPECT_EQ(surfel_cloud(raw_surfels(cloud, 0)).sh.size(), 1U);
  const renderer::SurfelCloud more = surfel_cloud(raw_surfels(cloud, 2));
  ASSERT_EQ(more.sh.size(), 9U);
  EXPECT_EQ(more.sh[3], cloud.sh[3]);
  EXPECT_EQ(more.sh[4], glm::vec3(0.0F));
  cloud.opacity[0] = 1.0F;
  EXPECT_TRUE(std::isfinite(raw_surfels(cloud, 1).opacity_logit[0]));
}

/// A wall at z = 2 in front of a camera at the origin.
TrainingView wall_view() {
  TrainingView view;
  view.rgb = core::Image<core::Rgb8>(8, 6, {255, 0, 51});
  view.depth_m = core::Image<float>(8, 6, 2.0F);
  return view;
}

TEST(HoleFiller, FillsWhereNothingIsDrawn) {
  const TrainingView view = wall_view();
  const auto camera = core::CameraIntrinsics::from_fov(8, 6, 1.0);
  std::vector<float> alpha(48, 1.0F);
  alpha[2 * 8 + 4] = 0.1F;
  alpha[3 * 8 + 5] = 0.1F;  // Not on the grid of every second pixel.
  HoleFiller filler(0.01, 1);
  filler.add_view(view, view.T_world_camera, camera, alpha, 0.1, 10.0);
  filler.add_view(view, view.T_world_camera, camera, alpha, 0.1, 10.0);  // The place is taken.
  ASSERT_EQ(filler.pending().count(), 1);
  const RawSurfels taken = filler.take(10);
  EXPECT_EQ(filler.pending().count(), 0);
  const renderer::SurfelCloud cloud = surfel_cloud(taken);
  const glm::dvec3 expected = camera.back_project({4.5, 2.5}, 2.0);
  EXPECT_NEAR(cloud.position_m[0].x, expected.x, 1e-5);
  EXPECT_NEAR(cloud.position_m[0].z, 2.0, 1e-5);
  const glm::vec3 normal = cloud.R_world_surfel[0] * glm::vec3(0.0F, 0.0F, 1.0F);
  EXPECT_NEAR(normal.z, -1.0F, 1e-3F);
  EXPECT_NEAR(0.5F + renderer::kShC0 * cloud.sh[0].r, 1.0F, 1e-5F);
  EXPECT_NEAR(0.5F + renderer::kShC0 * cloud.sh[0].b, 0.2F, 1e-5F);
  EXPECT_EQ(cloud.sh.size(), 4U);
}

TEST(HoleFiller, KeepsToTheBudgetAndToWhatTheSensorMeasured) {
  TrainingView view = wall_view();
  view.depth_m(0, 0) = std::nanf("");
  view.depth_m(2, 0) = 50.0F;
  view.valid = core::Image<std::uint8_t>(8, 6, 1);
  view.valid(4, 0) = 0;
  const auto camera = core::CameraIntrinsics::from_fov(8, 6, 1.0);
  const std::vector<float> alpha(48, 0.0F);
  HoleFiller filler(0.01, 0);
  filler.add_view(view, view.T_world_camera, camera, alpha, 0.1, 10.0);
  EXPECT_EQ(filler.pending().count(), 12 - 3);
  for (std::size_t i = 2; i < filler.pending().position_m.size(); i += 3) {
    EXPECT_NEAR(filler.pending().position_m[i], 2.0F, 1e-5F);
  }
  HoleFiller other(0.01, 0);
  other.restore(filler.pending());
  other.add_view(view, view.T_world_camera, camera, alpha, 0.1, 10.0);
  EXPECT_EQ(other.pending().count(), 9);
  EXPECT_EQ(filler.take(4).count(), 4);
  EXPECT_EQ(filler.take(4).count(), 0);
  EXPECT_THROW(filler.add_view(view, view.T_world_camera, camera, {}, 0.1, 10.0),
               core::ContractViolation);
}

}  // namespace
}  // namespace segsim::reconstruction
