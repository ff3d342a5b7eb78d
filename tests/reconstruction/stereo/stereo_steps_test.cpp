// The steps of multi-view stereo, each against a closed form: pictures of planes, whose depth
// is known everywhere.

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gmock/gmock.h>

#include "core/quantile.h"
#include "reconstruction/stereo/internal/plane_sweep.h"
#include "reconstruction/stereo/internal/semi_global.h"
#include "reconstruction/stereo/internal/slanted_refinement.h"
#include "reconstruction/stereo/internal/source_views.h"
#include "reconstruction/stereo/internal/view_consistency.h"
#include "reconstruction/stereo/internal/working_view.h"

namespace segsim::reconstruction::internal {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

const core::CameraIntrinsics kCamera =
    core::CameraIntrinsics::from_fov(96, 72, 60.0 * std::numbers::pi / 180.0);

core::CameraPose at(double x_m, double y_m = 0.0) {
  return {glm::dquat(1.0, 0.0, 0.0, 0.0), {x_m, y_m, 0.0}};
}

/// The plane z = distance + slope y, with waves of several lengths on it.
struct WavyPlane {
  double distance_m = 2.0, slope = 0.0;

  [[nodiscard]] double depth_m(const core::CameraPose& pose, const glm::dvec2& px) const {
    const glm::dvec3 ray = pose.rotation() * kCamera.back_project(px, 1.0);
    const glm::dvec3 eye = pose.translation_m();
    return (distance_m + slope * eye.y - eye.z) / (ray.z - slope * ray.y);
  }
  [[nodiscard]] core::Image<std::uint16_t> picture(const core::CameraPose& pose) const {
    core::Image<std::uint16_t> grey(kCamera.width_px, kCamera.height_px);
    for (int y = 0; y < grey.height_px(); ++y) {
      for (int x = 0; x < grey.width_px(); ++x) {
        const glm::dvec2 px(x + 0.5, y + 0.5);
        const core::Point<core::frame::Camera> p{kCamera.back_project(px, depth_m(pose, px))};
        const glm::dvec3 q = (pose * p).xyz_m;
        const double waves =
            std::sin(23.0 * q.x + 3.0 * q.y) + std::sin(17.0 * q.y - 5.0 * q.x) +
            std::sin(11.0 * q.x + 13.0 * q.y + 1.0) + std::sin(31.0 * q.x - 29.0 * q.y);
        grey(x, y) = static_cast<std::uint16_t>(256.0 * (128.0 + 25.0 * waves));
      }
    }
    return grey;
  }
};

/// A reference at the origin and four sources around it.
struct Rig {
  explicit Rig(const WavyPlane& plane) : reference(plane.picture(at(0.0))) {
    for (const core::CameraPose& pose : {at(0.25), at(-0.25), at(0.0, 0.25), at(0.0, -0.25)}) {
      pictures.push_back(plane.picture(pose));
      warps.push_back(warp_between(at(0.0), pose, kCamera));
    }
    for (const auto& picture : pictures) sources.push_back(&picture);
  }
  core::Image<std::uint16_t> reference;
  std::vector<core::Image<std::uint16_t>> pictures;
  std::vector<const core::Image<std::uint16_t>*> sources;
  std::vector<ViewWarp> warps;
};

/// Errors of depth, relative, away from the border.
std::vector<double> errors(const core::Image<float>& inverse_m, const WavyPlane& plane) {
  std::vector<double> shares;
  for (int y = 8; y < inverse_m.height_px() - 8; ++y) {
    for (int x = 8; x < inverse_m.width_px() - 8; ++x) {
      const double truth_m = plane.depth_m(at(0.0), {x + 0.5, y + 0.5});
      shares.push_back(std::abs(1.0 / inverse_m(x, y) / truth_m - 1.0));
    }
  }
  return shares;
}

TEST(WorkingView, GreyIsTheMeanOfThePixels) {
  core::Image<core::Rgb8> rgb(6, 4, {10, 10, 10});
  rgb(0, 0) = rgb(1, 1) = {30, 30, 30};  // Of 3 x 2 pixels: two of six.
  const auto grey = grey_of(rgb, 2, 2);
  EXPECT_NEAR(grey(0, 0), 256.0 * (10.0 + 20.0 / 3.0), 1.0);
  EXPECT_NEAR(grey(1, 1), 2560.0, 1.0);
  core::Image<std::uint16_t> two(5, 4, 100);
  two(0, 0) = 500;
  EXPECT_EQ(shrunk(two, 2).width_px(), 2);
  EXPECT_EQ(shrunk(two, 2)(0, 0), 200);
  EXPECT_EQ(shrunk(two, 2)(1, 1), 100);
}

TEST(WorkingView, WarpIsProjection) {
  const core::CameraPose from{glm::normalize(glm::dquat(0.9, 0.1, -0.2, 0.3)),
                              {1.0, 2.0, 3.0}};
  const core::CameraPose to{glm::normalize(glm::dquat(0.9, 0.15, -0.1, 0.28)),
                            {1.2, 2.1, 2.9}};
  const ViewWarp map = warp_between(from, to, kCamera);
  const glm::dvec2 px(20.0, 50.0);
  const double depth_m = 1.7;
  const core::Point<core::frame::Camera> p{kCamera.back_project(px, depth_m)};
  const glm::dvec3 there = (to.inverse() * (from * p)).xyz_m;
  const glm::vec3 h = map.a * glm::vec3(px, 1.0) + static_cast<float>(1.0 / depth_m) * map.b;
  EXPECT_NEAR(h.x / h.z, kCamera.project(there).x, 1e-3);
  EXPECT_NEAR(h.y / h.z, kCamera.project(there).y, 1e-3);
  EXPECT_NEAR(h.z, there.z / depth_m, 1e-5);
}

TEST(SourceViews, WantedAngleBeatsNearAndFarAndOtherDirections) {
  const double baseline_m = 2.0 * std::tan(wanted_angle_rad(kCamera));
  const std::vector<core::CameraPose> poses{
      at(0.0),
      at(0.02 * baseline_m),
      at(baseline_m),
      at(4.0 * baseline_m),
      // The wanted distance, but it looks back.
      {glm::dquat(0.0, 0.0, 1.0, 0.0), {baseline_m, 0.0, 0.0}}};
  const std::vector<DepthRange> ranges(poses.size(), {1.8, 2.0, 2.2});
  EXPECT_THAT(choose_sources(0, poses, ranges, kCamera, 4, 8).matched, ElementsAre(2));
}

TEST(SourceViews, OfEqualViewsThoseThatLieApartAreMatched) {
  const double b = 2.0 * std::tan(wanted_angle_rad(kCamera));
  const std::vector<core::CameraPose> poses{at(0.0), at(b), at(1.05 * b), at(0.95 * b),
                                            at(-b)};
  const std::vector<DepthRange> ranges(poses.size(), {1.8, 2.0, 2.2});
  const SourceViews sources = choose_sources(0, poses, ranges, kCamera, 2, 8);
  ASSERT_EQ(sources.matched.size(), 2U);
  EXPECT_TRUE(sources.matched[0] == 4 || sources.matched[1] == 4);
  EXPECT_EQ(sources.compared.size(), 4U);
}

TEST(SourceViews, TurningAloneGivesNone) {
  std::vector<core::CameraPose> poses;
  for (int i = 0; i < 9; ++i) {
    poses.emplace_back(glm::angleAxis(0.1 * i, glm::dvec3(0.0, 1.0, 0.0)), glm::dvec3(0.0));
  }
  const std::vector<DepthRange> ranges(poses.size(), {1.0, 2.0, 4.0});
  EXPECT_THAT(choose_sources(4, poses, ranges, kCamera, 4, 8).matched, IsEmpty());
}

TEST(PlaneSweep, PlanesCoverTheRangeInStepsOfAPixel) {
  const std::vector<ViewWarp> warps{warp_between(at(0.0), at(0.3), kCamera)};
  const SweepPlanes planes = sweep_planes({1.0, 2.0, 4.0}, warps, kCamera);
  EXPECT_EQ(planes.count % 8, 0);
  EXPECT_NEAR(planes.inverse_m(0.0F), 0.25F, 1e-6);
  EXPECT_NEAR(planes.inverse_m(static_cast<float>(planes.count - 1)), 1.0F, 1e-5);
  // Parallax of f b / z.
  EXPECT_LE(kCamera.fx_px * 0.3 * planes.step_inverse_m, 1.0);
  EXPECT_GT(kCamera.fx_px * 0.3 * planes.step_inverse_m, 0.5);
}

TEST(PlaneSweep, LowestCostIsAtTheDepthOfThePlane) {
  const WavyPlane plane;
  const Rig rig(plane);
  const SweepPlanes planes = sweep_planes({1.0, 2.0, 4.0}, rig.warps, kCamera);
  const CostVolume volume = sweep(rig.reference, rig.sources, rig.warps, planes);
  const float truth = (0.5F - planes.first_inverse_m) / planes.step_inverse_m;
  int right = 0, all = 0;
  for (int y = 8; y < 64; ++y) {
    for (int x = 8; x < 88; ++x, ++all) {
      const std::uint8_t* cost = volume.at(x, y);
      const auto best = std::min_element(cost, cost + planes.count) - cost;
      right += std::abs(static_cast<float>(best) - truth) <= 1.0F ? 1 : 0;
    }
  }
  EXPECT_GT(right, 97 * all / 100);
}

TEST(PlaneSweep, KnownPointsMakeTheirDepthCheap) {
  CostVolume volume{96, 72, {0.25F, 0.01F, 80}, {}};
  volume.cost.assign(96UL * 72 * 80, 80);
  const std::vector<glm::vec3> points_m{glm::vec3(kCamera.back_project({40.5, 30.5}, 2.0)),
                                        glm::vec3(kCamera.back_project({40.5, 30.5}, 9.0)),
                                        glm::vec3(kCamera.back_project({-9.0, 30.5}, 2.0))};
  seed_costs(points_m, kCamera, volume);
  EXPECT_EQ(volume.at(40, 30)[25], 20);
  EXPECT_EQ(volume.at(41, 31)[25], 20);
  EXPECT_EQ(volume.at(40, 30)[24], 80);
  EXPECT_EQ(std::count(volume.cost.begin(), volume.cost.end(), 20), 9);
}

TEST(SemiGlobal, BridgesWhatHasNoTexture) {
  // A column without any information between pixels that know their plane.
  CostVolume volume{9, 5, {0.1F, 0.1F, 16}, {}};
  volume.cost.assign(9UL * 5 * 16, 50);
  for (int y = 0; y < 5; ++y) {
    for (const int x : {0, 1, 2, 6, 7, 8}) volume.at(x, y)[6] = 0;
  }
  const core::Image<float> inverse_m =
      semi_global(volume, core::Image<std::uint16_t>(9, 5, 1000));
  for (const float value : inverse_m.pixels()) EXPECT_NEAR(value, 0.7F, 0.011F);
}

TEST(SemiGlobal, NothingWhereAllDepthsAreEqual) {
  CostVolume volume{4, 4, {0.1F, 0.1F, 16}, {}};
  volume.cost.assign(4UL * 4 * 16, 50);
  const core::Image<float> inverse_m = semi_global(volume, core::Image<std::uint16_t>(4, 4));
  for (const float value : inverse_m.pixels()) {
    EXPECT_TRUE(std::isnan(value));
  }
}

TEST(SlantedRefinement, HalvesTheErrorOnAFloor) {
  // Seen under 45 degrees.
  const WavyPlane plane{2.0, 1.0};
  const Rig rig(plane);
  const SweepPlanes planes = sweep_planes({0.8, 2.0, 6.0}, rig.warps, kCamera);
  core::Image<float> inverse_m =
      semi_global(sweep(rig.reference, rig.sources, rig.warps, planes), rig.reference);
  const double before = core::quantile(errors(inverse_m, plane), 0.5, core::Between::kNearest);
  refine_slanted(rig.reference, rig.sources, rig.warps, planes.step_inverse_m, inverse_m);
  const std::vector<double> after = errors(inverse_m, plane);
  EXPECT_LT(core::quantile(after, 0.5, core::Between::kNearest), 0.5 * before);
  EXPECT_LT(core::quantile(after, 0.9, core::Between::kNearest), 0.01);
}

/// Views side by side of a plane 2 m ahead.
std::vector<MatchedView> plane_views(int count) {
  std::vector<MatchedView> views;
  for (int i = 0; i < count; ++i) {
    views.push_back({core::Image<float>(96, 72, 0.5F), at(0.1 * i), 0.01F});
  }
  return views;
}

TEST(ViewConsistency, KeepsTheMeanOfThoseThatAgree) {
  std::vector<MatchedView> views = plane_views(3);
  for (float& value : views[1].inverse_m.pixels()) value = 0.503F;
  for (float& value : views[2].inverse_m.pixels()) value = 0.506F;
  const std::vector<std::uint32_t> others{1, 2};
  const core::Image<float> depth_m = agreed_depth(0, others, views, kCamera, 2);
  EXPECT_NEAR(depth_m(60, 36), 1.0 / 0.503, 1e-4);
  EXPECT_TRUE(std::isnan(depth_m(0, 36)));  // Out of the others' sight.
}

TEST(ViewConsistency, DropsWhatOthersLookThroughOrDoNotKnow) {
  std::vector<MatchedView> views = plane_views(5);
  for (int y = 20; y < 40; ++y) {
    for (int x = 40; x < 60; ++x) views[0].inverse_m(x, y) = 1.0F;  // A ghost at 1 m.
  }
  for (float& value : views[4].inverse_m.pixels()) value = std::nanf("");
  const std::vector<std::uint32_t> three{1, 2, 4}, one{1, 4};
  const core::Image<float> depth_m = agreed_depth(0, three, views, kCamera, 2);
  EXPECT_TRUE(std::isnan(depth_m(50, 30)));
  EXPECT_NEAR(depth_m(80, 60), 2.0F, 1e-5);
  const core::Image<float> lonely_m = agreed_depth(0, one, views, kCamera, 2);
  for (const float z : lonely_m.pixels()) {
    EXPECT_TRUE(std::isnan(z));  // One other view is not two.
  }
}

}  // namespace
}  // namespace segsim::reconstruction::internal
