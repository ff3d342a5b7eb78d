#include "sim/sensors/depth_sensor.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <set>

#include <gtest/gtest.h>

namespace segsim::sim {
namespace {

using Depth = core::Image<float>;
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

const core::CameraIntrinsics kCamera = core::CameraIntrinsics::from_fov(640, 480, 1.2);

Depth measured(const DepthModel& model, const Depth& truth, std::uint64_t capture = 0) {
  Depth made;
  measure_depth(model, kCamera, PixelNoise(1, "camera/depth", capture), truth, made);
  return made;
}

struct Statistics {
  double mean = 0.0, deviation = 0.0;
  std::size_t count = 0;
};

Statistics statistics(const Depth& image) {
  Statistics s;
  double squares = 0.0;
  for (const float z : image.pixels()) {
    if (std::isnan(z)) continue;
    ++s.count;
    s.mean += z;
    squares += double{z} * z;
  }
  s.mean /= static_cast<double>(s.count);
  s.deviation = std::sqrt(squares / static_cast<double>(s.count) - s.mean * s.mean);
  return s;
}

TEST(DepthSensor, IdealDepthIsCutAtItsRange) {
  Depth truth(6, 1);
  truth.pixels() = {kNone, 0.0F, 0.3F, 2.5F, 6.0F, 6.0001F};
  DepthModel model;
  const Depth far = measured(model, truth);
  EXPECT_TRUE(std::isnan(far(0, 0)));
  EXPECT_TRUE(std::isnan(far(1, 0)));
  EXPECT_EQ(far(2, 0), 0.3F);
  EXPECT_EQ(far(3, 0), 2.5F);
  EXPECT_EQ(far(4, 0), 6.0F);
  EXPECT_TRUE(std::isnan(far(5, 0)));
  model.min_range_m = 0.5;
  EXPECT_TRUE(std::isnan(measured(model, truth)(2, 0)));
}

TEST(DepthSensor, KinectNoiseGrowsWithTheSquareOfTheDistance) {
  DepthModel model;
  model.noise = DepthNoise::kKinectAxial;
  model.max_range_m = 20.0;
  for (const float z : {0.4F, 1.4F, 4.0F}) {
    const double expected = 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4);
    const Statistics found = statistics(measured(model, Depth(640, 480, z)));
    EXPECT_NEAR(found.deviation, expected, 0.01 * expected) << z;
    EXPECT_NEAR(found.mean, z, 4.0 * expected / std::sqrt(640.0 * 480.0)) << z;
  }
  // 0.0012, 0.0031 and 0.025824 m.
  EXPECT_NEAR(kinect_axial_sigma_m(4.0F), 0.025824F, 1e-6F);
}

TEST(DepthSensor, RedwoodAnswersInEighthsOfADisparity) {
  DepthModel model;
  model.noise = DepthNoise::kRedwood;
  model.max_range_m = 20.0;
  const float truth_m = 3.0F;  // 11.71 disparities.
  const Depth found = measured(model, Depth(640, 480, truth_m));
  std::set<long> steps;
  for (const float z : found.pixels()) {
    const double eighths = 8.0 * 35.130 / z;
    EXPECT_NEAR(eighths, std::round(eighths), 1e-3);
    steps.insert(std::lround(eighths));
  }
  // 93.68 eighths with a sigma of 0.2222: 93, 94 and, seldom, their neighbours.
  EXPECT_GE(steps.size(), 2U);
  EXPECT_LE(steps.size(), 4U);
  EXPECT_TRUE(steps.contains(93) && steps.contains(94));
  // The share of 93: Phi((93.5 - 93.68) / 0.2222) = Phi(-0.8101) = 0.2089.
  const auto of_93 = std::count_if(found.pixels().begin(), found.pixels().end(), [](float z) {
    return std::lround(8.0 * 35.130 / z) == 93;
  });
  EXPECT_NEAR(static_cast<double>(of_93) / (640.0 * 480.0), 0.2089, 0.004);
  // Nothing from 10 m on.
  EXPECT_TRUE(std::isnan(measured(model, Depth(640, 480, 10.0F))(3, 3)));
  EXPECT_FALSE(std::isnan(measured(model, Depth(640, 480, 9.9F))(3, 3)));
}

TEST(DepthSensor, RedwoodShakesPixelsSideways) {
  // A step between columns 319 and 320. Pixels are read on even columns, so without jitter
  // column 320 is the first far one. A column x moves to the other side with
  // P(|N(0, 0.25)| > distance to the middle between two pixels).
  DepthModel model;
  model.noise = DepthNoise::kRedwood;
  Depth truth(640, 480, 1.0F);
  for (int y = 0; y < 480; ++y) {
    for (int x = 320; x < 640; ++x) truth(x, y) = 4.0F;
  }
  int near_at_320 = 0, far_at_319 = 0, wrong_elsewhere = 0;
  for (std::uint64_t capture = 0; capture < 20; ++capture) {
    const Depth found = measured(model, truth, capture);
    for (int y = 0; y < 480; ++y) {
      near_at_320 += found(320, y) < 2.0F ? 1 : 0;
      far_at_319 += found(319, y) > 2.0F ? 1 : 0;
      wrong_elsewhere += found(310, y) > 2.0F || found(330, y) < 2.0F ? 1 : 0;
    }
  }
  // P(N < -0.5 px) with sigma 0.25 px: Phi(-2) = 0.02275; 9600 pixels: 218 +- 15.
  EXPECT_NEAR(near_at_320, 218, 60);
  EXPECT_NEAR(far_at_319, 218, 60);
  EXPECT_EQ(wrong_elsewhere, 0);
}

TEST(DepthSensor, PixelsFlyAtEdgesAlone) {
  Depth truth(640, 480, 1.0F);
  for (int y = 0; y < 480; ++y) {
    for (int x = 320; x < 640; ++x) truth(x, y) = 3.0F;
  }
  DepthModel model;
  model.flying_pixels = 0.25;
  const Depth found = measured(model, truth);
  int flying = 0;
  double sum = 0.0;
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      const bool at_edge = x == 319 || x == 320;
      if (found(x, y) == truth(x, y)) continue;
      ASSERT_TRUE(at_edge) << x;
      ASSERT_GE(found(x, y), 1.0F);
      ASSERT_LE(found(x, y), 3.0F);
      ++flying;
      sum += found(x, y);
    }
  }
  // 960 pixels at the edge, 240 of them: sigma 13.4.
  EXPECT_NEAR(flying, 240, 54);
  EXPECT_NEAR(sum / flying, 2.0, 4.0 * (2.0 / std::sqrt(12.0)) / std::sqrt(flying));
  // Holes are no edges, and gentle slopes neither.
  Depth slope(640, 480, kNone);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 600; ++x) slope(x, y) = 1.0F + 0.005F * static_cast<float>(x);
  }
  model.flying_pixels = 1.0;
  const Depth kept = measured(model, slope);
  for (int x = 0; x < 600; ++x) EXPECT_EQ(kept(x, 7), slope(x, 7));
  EXPECT_TRUE(std::isnan(kept(620, 7)));
}

/// A plane through (0, 0, 2) whose normal is turned by `tilt` from the optical axis.
Depth tilted_plane(double tilt_rad) {
  const glm::dvec3 normal(std::sin(tilt_rad), 0.0, std::cos(tilt_rad));
  Depth truth(640, 480, kNone);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      const glm::dvec3 ray = kCamera.back_project({x + 0.5, y + 0.5}, 1.0);
      const double across = normal.x * ray.x + normal.y * ray.y + normal.z * ray.z;
      const double z = 2.0 * normal.z / across;
      if (z > 0.0 && z < 6.0) truth(x, y) = static_cast<float>(z);
    }
  }
  return truth;
}

TEST(DepthSensor, GrazingSurfacesDropOutAtTheLimit) {
  DepthModel model;
  model.grazing_limit_rad = 75.0 * std::numbers::pi / 180.0;
  int dropped = 0, kept = 0;
  for (const double tilt_deg : {20.0, 60.0, 80.0}) {
    const double tilt = tilt_deg * std::numbers::pi / 180.0;
    const Depth truth = tilted_plane(tilt);
    const Depth found = measured(model, truth);
    for (int y = 0; y < 480; ++y) {
      for (int x = 1; x + 1 < 640; ++x) {
        if (std::isnan(truth(x, y))) continue;
        const glm::dvec3 ray = kCamera.back_project({x + 0.5, y + 0.5}, 1.0);
        const double cosine = (std::sin(tilt) * ray.x + std::cos(tilt) * ray.z) /
                              std::sqrt(ray.x * ray.x + ray.y * ray.y + 1.0);
        const double angle = std::acos(std::abs(cosine));
        // Depth is a float: half a degree of doubt.
        if (std::abs(angle - model.grazing_limit_rad) < 0.009) continue;
        const bool drops = angle > model.grazing_limit_rad;
        ASSERT_EQ(std::isnan(found(x, y)), drops) << tilt_deg << " at " << x << ", " << y;
        drops ? ++dropped : ++kept;
      }
    }
  }
  EXPECT_GT(dropped, 1000);
  EXPECT_GT(kept, 100000);
}

TEST(DepthSensor, AnEdgeIsNoGrazingSurface) {
  Depth truth(640, 480, 1.0F);
  for (int y = 0; y < 480; ++y) {
    for (int x = 320; x < 640; ++x) truth(x, y) = 3.0F;
  }
  truth(100, 100) = kNone;
  DepthModel model;
  model.grazing_limit_rad = 1.4;
  const Depth found = measured(model, truth);
  for (int x = 0; x < 640; ++x) EXPECT_EQ(found(x, 50), truth(x, 50)) << x;
  EXPECT_EQ(found(101, 100), 1.0F);
  EXPECT_TRUE(std::isnan(found(100, 100)));
}

TEST(DepthSensor, NoiseIsOfTheCapture) {
  DepthModel model;
  model.noise = DepthNoise::kKinectAxial;
  const Depth truth(64, 48, 2.0F);
  EXPECT_EQ(measured(model, truth, 3).pixels(), measured(model, truth, 3).pixels());
  EXPECT_NE(measured(model, truth, 3).pixels(), measured(model, truth, 4).pixels());
  // A hole elsewhere shifts nothing.
  Depth holed = truth;
  holed(5, 5) = kNone;
  const Depth a = measured(model, truth, 3), b = measured(model, holed, 3);
  for (std::size_t k = 0; k < a.size(); ++k) {
    if (!std::isnan(b.pixels()[k])) {
      EXPECT_EQ(a.pixels()[k], b.pixels()[k]);
    }
  }
}

}  // namespace
}  // namespace segsim::sim
