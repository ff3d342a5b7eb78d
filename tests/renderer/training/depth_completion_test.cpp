#include "renderer/training/depth_completion.h"

#include <cmath>

#include <gtest/gtest.h>

namespace segsim::renderer {
namespace {

TEST(DepthCompletion, MeasuredDepthStaysAndHolesTakeTheirSurroundings) {
  // A slope of 1 cm a pixel with a hole in the middle.
  core::Image<float> depth_m(45, 31);
  const auto slope_m = [](int x) { return 2.0F + 0.01F * static_cast<float>(x); };
  for (int y = 0; y < 31; ++y) {
    for (int x = 0; x < 45; ++x) {
      const bool hole = x >= 18 && x < 27 && y >= 10 && y < 19;
      depth_m(x, y) = hole ? std::nanf("") : slope_m(x);
    }
  }
  depth_m(3, 4) = 0.05F;  // Too near and too far to be believed.
  depth_m(40, 20) = 30.0F;
  const core::Image<float> completed = completed_depth_m(depth_m, 0.1, 10.0);
  for (int y = 0; y < 31; ++y) {
    for (int x = 0; x < 45; ++x) {
      const bool measured = depth_m(x, y) > 0.1F && depth_m(x, y) < 10.0F;
      if (measured) {
        EXPECT_EQ(completed(x, y), depth_m(x, y));
      } else {
        EXPECT_NEAR(completed(x, y), slope_m(x), 0.06) << x << ", " << y;
      }
    }
  }
}

TEST(DepthCompletion, OneMeasurementFillsAll) {
  core::Image<float> depth_m(7, 5, std::nanf(""));
  depth_m(6, 0) = 3.0F;
  const core::Image<float> completed = completed_depth_m(depth_m, 0.1, 10.0);
  for (std::size_t i = 0; i < completed.size(); ++i) EXPECT_EQ(completed.data()[i], 3.0F);
}

TEST(DepthCompletion, NothingComesFromNothing) {
  const core::Image<float> none = completed_depth_m({7, 5, 0.0F}, 0.1, 10.0);
  ASSERT_EQ(none.size(), 35U);
  for (std::size_t i = 0; i < none.size(); ++i) EXPECT_TRUE(std::isnan(none.data()[i]));
  EXPECT_TRUE(completed_depth_m({}, 0.1, 10.0).empty());
}

}  // namespace
}  // namespace segsim::renderer
