#include "experiments/drawing/odom_placement.h"

#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "experiments/drawing/map_canvas.h"

namespace segsim::experiments {
namespace {

TEST(OdomPlacement, TheRobotLiesWhereItIsAndTheWayBackIsExact) {
  const core::Pose2 truth{2.0, -1.0, 1.2}, estimate{1.5, 0.5, 0.7};
  const drawing::OdomPlacement placement(truth, estimate);
  const glm::dvec2 robot_m = placement.to_world({estimate.x_m, estimate.y_m});
  EXPECT_DOUBLE_EQ(robot_m.x, truth.x_m);
  EXPECT_DOUBLE_EQ(robot_m.y, truth.y_m);
  // A metre ahead in Odom is a metre ahead in World.
  const glm::dvec2 ahead_m =
      placement.to_world({estimate.x_m + std::cos(0.7), estimate.y_m + std::sin(0.7)});
  EXPECT_NEAR(ahead_m.x, truth.x_m + std::cos(1.2), 1e-12);
  EXPECT_NEAR(ahead_m.y, truth.y_m + std::sin(1.2), 1e-12);
  const glm::dvec2 back_m = placement.to_odom(placement.to_world({3.0, 4.0}));
  EXPECT_NEAR(back_m.x, 3.0, 1e-12);
  EXPECT_NEAR(back_m.y, 4.0, 1e-12);
}

TEST(OdomPlacement, PerfectLocalisationChangesNoBit) {
  const core::Pose2 pose{0.1, 0.2, 0.3};
  EXPECT_EQ(drawing::OdomPlacement(pose, pose).to_world({0.7, 1.0 / 3.0}),
            glm::dvec2(0.7, 1.0 / 3.0));
  EXPECT_EQ(drawing::OdomPlacement().to_odom({0.7, 1.0 / 3.0}), glm::dvec2(0.7, 1.0 / 3.0));
}

/// Centre of the pixels that differ between two pictures.
cv::Point2d centre_of_change(const cv::Mat& a, const cv::Mat& b) {
  cv::Point2d sum;
  int count = 0;
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) {
      if (a.at<cv::Vec3b>(y, x) == b.at<cv::Vec3b>(y, x)) continue;
      sum += cv::Point2d(x + 0.5, y + 0.5);
      ++count;
    }
  }
  return count == 0 ? cv::Point2d(-1.0, -1.0) : sum / count;
}

TEST(MapCanvas, DrawsADriftedMapWhereItLiesInWorld) {
  drawing::FloorPlan plan;
  plan.rgb = core::Image<core::Rgb8>(400, 400, {200, 200, 200});
  plan.px_per_m = 100.0;  // World [0, 4] x [0, 4].
  core::PolicyView view;
  view.objects = {{{1.0, 1.0}, 0, 0.9F}};
  // Known everywhere but in one cell, the one that the object lies in.
  view.resolution_m = 0.25;
  view.origin_m = {-3.0, -3.0};
  view.cells = core::Image<std::uint8_t>(40, 40, 1);
  view.cells(16, 16) = 0;
  // Half a turn: Odom's (1, 1) is World's (3, 2).
  const double pi = std::acos(-1.0);
  const drawing::OdomPlacement placement({4.0, 3.0, pi}, {0.0, 0.0, 0.0});
  const cv::Mat blank = drawing::MapCanvas(plan, 1.0).image();
  drawing::MapCanvas objects(plan, 1.0), cells(plan, 1.0);
  for (drawing::MapCanvas* map : {&objects, &cells}) map->place_views(placement);
  objects.draw_objects(view, 0);
  cells.draw_knowledge(view);
  const cv::Point2d object = centre_of_change(objects.image(), blank);
  EXPECT_NEAR(object.x, 300.0, 2.0);
  EXPECT_NEAR(object.y, 200.0, 2.0);
  const cv::Point2d cell = centre_of_change(cells.image(), blank);
  EXPECT_NEAR(cell.x, 300.0 - 12.5, 1.0);  // Cell (16, 16) spans Odom 1 to 1.25 m.
  EXPECT_NEAR(cell.y, 200.0 + 12.5, 1.0);
}

TEST(MapCanvas, ShadesTheInsideOfGoals) {
  drawing::FloorPlan plan;
  plan.rgb = core::Image<core::Rgb8>(400, 400, {200, 200, 200});
  plan.px_per_m = 100.0;
  core::SceneManifest manifest;
  core::SceneInstance chair;
  chair.id = 7;
  chair.class_id = 3;
  chair.box_min_m = {2.0, 1.0, 0.0};
  chair.box_max_m = {3.0, 1.5, 1.0};
  manifest.instances = {chair};
  manifest.classes = {{.id = 3, .name = "chair", .thing = true}};
  sim::Episode episode;
  episode.class_name = "chair";
  drawing::MapCanvas empty(plan, 1.0);
  drawing::MapCanvas map = empty.clone();
  map.draw_goals(manifest, {manifest, episode});
  const auto pixel = [&map](int x, int y) { return map.image().at<cv::Vec3b>(y, x); };
  const auto shade = [](int c) {
    return static_cast<std::uint8_t>(std::lround(0.28 * drawing::ink::kGoal[c] + 0.72 * 200));
  };
  const cv::Vec3b inside(shade(0), shade(1), shade(2)), outside(200, 200, 200);
  for (const int x : {205, 250, 295}) {
    EXPECT_EQ(pixel(x, 255), inside) << x;
    EXPECT_EQ(pixel(x, 295), inside) << x;
  }
  EXPECT_EQ(pixel(195, 275), outside);
  EXPECT_EQ(pixel(250, 305), outside);
  EXPECT_EQ(empty.image().at<cv::Vec3b>(275, 250), outside) << "the copy has its own pixels";
}

}  // namespace
}  // namespace segsim::experiments
