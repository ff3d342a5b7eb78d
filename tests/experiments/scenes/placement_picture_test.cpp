#include "experiments/scenes/placement_picture.h"

#include <vector>

#include <gtest/gtest.h>

#include "experiments/drawing/map_canvas.h"

namespace segsim::experiments {
namespace {

using reconstruction::SurfaceElement;

/// A floor at z = 0 and a ceiling at 2.5 m, seen from between.
reconstruction::WorldPlacement between_floor_and_ceiling() {
  reconstruction::WorldPlacement placement;
  placement.floor_source = reconstruction::FloorSource::kGuessed;
  placement.floor = reconstruction::FloorEvidence{0.0, true, 0.0, 1.0, 0.5};
  for (int x = 0; x < 40; ++x) {
    for (int y = 0; y < 20; ++y) {
      const glm::dvec3 p(0.1 * x, 0.1 * y, 0.0);
      placement.elements.push_back({p, {0, 0, 1}});
      placement.elements.push_back({p + glm::dvec3(0, 0, 2.5), {0, 0, -1}});
    }
  }
  return placement;
}

/// Mean row of the pixels of the side view that have the colour; -1 without any.
double mean_row(const core::Image<core::Rgb8>& image, const cv::Scalar& bgr) {
  double sum = 0.0, count = 0.0;
  for (int y = 60; y < image.height_px() - 40; ++y) {
    for (int x = 0; x < 850; ++x) {
      const core::Rgb8 pixel = image(x, y);
      if (pixel.b != bgr[0] || pixel.g != bgr[1] || pixel.r != bgr[2]) continue;
      sum += y, count += 1.0;
    }
  }
  return count == 0.0 ? -1.0 : sum / count;
}

TEST(PlacementPicture, ShowsCamerasBetweenFloorAndCeiling) {
  const std::vector<glm::dvec3> cameras_m{{1, 1, 1.5}, {2, 1, 1.5}, {3, 1, 1.5}};
  const auto picture = scenes::placement_picture(between_floor_and_ceiling(), cameras_m);
  ASSERT_FALSE(picture.empty());
  const double above = mean_row(picture, {200, 140, 40});  // Seen from below.
  const double cameras = mean_row(picture, drawing::ink::kNavigate);
  const double below = mean_row(picture, {70, 150, 10});  // Seen from above.
  const double floor = mean_row(picture, drawing::ink::kRecover);
  EXPECT_GT(above, 0.0);
  EXPECT_GT(cameras, above);
  EXPECT_GT(below, cameras);
  EXPECT_NEAR(floor, below, 20.0);
  // To scale: 1.5 m of 2.5 m lie between cameras and floor.
  EXPECT_NEAR((below - cameras) / (below - above), 0.6, 0.02);
}

TEST(PlacementPicture, IsEmptyWhereNothingHadToBeFoundOut) {
  EXPECT_TRUE(scenes::placement_picture({}, {}).empty());
}

}  // namespace
}  // namespace segsim::experiments
