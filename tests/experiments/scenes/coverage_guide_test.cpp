#include "experiments/scenes/coverage_guide.h"

#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>

#include <gtest/gtest.h>

#include "core/scene_bundle.h"
#include "experiments/scenes/scene_surfels.h"
#include "renderer/cpu_renderer.h"
#include "sim/ground/robot.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments::scenes {
namespace {

/// Two rooms of walls and a floor without a ceiling, seen from a height where none is seen.
class CoverageGuideOfTwoRooms : public testing::Test {
 protected:
  static constexpr double kLow_m = 0.4;

  CoverageGuideOfTwoRooms() {
    TinyScene().write(folder_.path() / "tiny");
    bundle_ = core::load_bundle(folder_.path() / "tiny");
    surfels_ = *load_scene_surfels(bundle_).surfels;
  }

  /// Takes surfels away.
  template <class Predicate>
  void remove_where(const Predicate& predicate) {
    renderer::SurfelCloud kept;
    kept.sh_degree = surfels_.sh_degree;
    for (std::size_t i = 0; i < surfels_.size(); ++i) {
      if (predicate(surfels_.position_m[i])) continue;
      kept.position_m.push_back(surfels_.position_m[i]);
      kept.R_world_surfel.push_back(surfels_.R_world_surfel[i]);
      kept.scale_m.push_back(surfels_.scale_m[i]);
      kept.opacity.push_back(surfels_.opacity[i]);
      kept.sh.push_back(surfels_.sh[i]);
    }
    surfels_ = kept;
  }

  [[nodiscard]] CoverageGuide guide(int poses) const {
    const auto renderer =
        renderer::make_cpu_renderer(std::make_shared<renderer::SurfelCloud>(surfels_));
    const sim::World world =
        sim::World::load(bundle_, sim::RobotModel::by_name("jackal-gentle"));
    CoverageGuideOptions options;
    options.camera_height_m = kLow_m;
    options.poses = poses;
    return coverage_guide(*renderer, world, scene_box(surfels_), options);
  }

  tests::TemporaryFolder folder_{"coverage_guide"};
  core::SceneBundle bundle_;
  renderer::SurfelCloud surfels_;
};

/// Of the wall at x = 4 m, between y = -0.5 m and 2 m.
bool in_the_gap(const glm::vec3& p) { return p.x > 3.9F && p.y > -0.5F && p.y < 2.0F; }

TEST_F(CoverageGuideOfTwoRooms, LooksAtTheHoleInTheWallFirst) {
  const double before = guide(1).missing;
  remove_where(in_the_gap);
  const CoverageGuide found = guide(3);
  EXPECT_GT(found.missing, before + 0.01);
  ASSERT_FALSE(found.poses.empty());
  const core::Pose2& first = found.poses.front().pose;
  const glm::dvec2 to_gap = glm::dvec2(4.0, 0.75) - glm::dvec2(first.x_m, first.y_m);
  const double off = core::wrap_angle_rad(std::atan2(to_gap.y, to_gap.x) - first.yaw_rad);
  EXPECT_LT(std::abs(off), std::numbers::pi / 5.0) << first.x_m << " " << first.y_m;
}

TEST_F(CoverageGuideOfTwoRooms, EachPoseAddsLessThanTheOneBefore) {
  remove_where(in_the_gap);
  remove_where([](const glm::vec3& p) { return p.x < -3.9F && p.y < 0.0F; });
  const CoverageGuide found = guide(6);
  ASSERT_GE(found.poses.size(), 2U);
  double sum = 0.0;
  for (std::size_t i = 0; i < found.poses.size(); ++i) {
    sum += found.poses[i].share;
    EXPECT_GT(found.poses[i].share, 0.0);
    if (i > 0) {
      EXPECT_LE(found.poses[i].share, found.poses[i - 1].share + 1e-12);
    }
  }
  EXPECT_LE(sum, 1.0 + 1e-9);
  // The two gaps are in opposite directions: the first two poses do not look the same way.
  const double turn =
      core::wrap_angle_rad(found.poses[0].pose.yaw_rad - found.poses[1].pose.yaw_rad);
  EXPECT_GT(std::abs(turn), std::numbers::pi / 4.0);
}

TEST_F(CoverageGuideOfTwoRooms, PlacesAreReachableAndAtTheirSpacing) {
  const CoverageGuide found = guide(0);
  EXPECT_TRUE(found.poses.empty());
  ASSERT_GT(found.places.size(), 50U);
  const sim::World world =
      sim::World::load(bundle_, sim::RobotModel::by_name("jackal-gentle"));
  for (const CoveragePlace& place : found.places) {
    EXPECT_TRUE(world.free_space().is_free(place.p_m));
    EXPECT_GE(place.missing, 0.0);
    EXPECT_LE(place.missing, 1.0);
  }
}

TEST_F(CoverageGuideOfTwoRooms, ThePictureShowsPlacesAndArrows) {
  remove_where(in_the_gap);
  const CoverageGuide found = guide(2);
  const drawing::FloorPlan plan = drawing::make_floor_plan(surfels_);
  const core::Image<core::Rgb8> image = coverage_picture(plan, found);
  EXPECT_EQ(image.width_px(), plan.rgb.width_px());
  EXPECT_GT(image.height_px(), plan.rgb.height_px());
  const CoveragePlace* good = &found.places.front();
  for (const CoveragePlace& place : found.places) {
    if (place.missing < good->missing) good = &place;
  }
  const glm::dvec2 px = plan.to_px(good->p_m);
  const core::Rgb8 color = image(static_cast<int>(px.x), static_cast<int>(px.y));
  EXPECT_GT(color.g, color.b) << "a place that sees well is green or yellow";
}

}  // namespace
}  // namespace segsim::experiments::scenes
