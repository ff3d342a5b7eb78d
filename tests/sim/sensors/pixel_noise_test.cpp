#include "sim/sensors/pixel_noise.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim {
namespace {

constexpr std::size_t kPixels = 640 * 480;

std::vector<float> normals(const PixelNoise& noise, std::uint32_t layer = 0,
                           std::size_t count = kPixels, std::uint32_t first = 0) {
  std::vector<float> values(count);
  noise.fill_normal(layer, first, values);
  return values;
}

/// Standard normal distribution function.
double phi(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

TEST(PixelNoise, IsBoxMullerOfPhilox) {
  const PixelNoise noise(7, "camera/rgb", 3);
  const std::vector<float> found = normals(noise, 2, 1000);
  const std::uint64_t key = core::hash64("camera/rgb", 7);
  for (std::uint32_t block = 0; block < 250; ++block) {
    const auto w = core::philox4x32({block, 2, 3, 0}, {static_cast<std::uint32_t>(key),
                                                       static_cast<std::uint32_t>(key >> 32)});
    for (std::size_t pair = 0; pair < 2; ++pair) {
      const double u = 1.0 - (w[2 * pair] >> 8) * 0x1.0p-24;
      const double angle = 2.0 * std::numbers::pi * ((w[2 * pair + 1] >> 8) * 0x1.0p-24 - 0.5);
      const double radius = std::sqrt(-2.0 * std::log(u));
      EXPECT_NEAR(found[4 * block + 2 * pair], radius * std::cos(angle), 3e-6);
      EXPECT_NEAR(found[4 * block + 2 * pair + 1], radius * std::sin(angle), 3e-6);
    }
  }
}

TEST(PixelNoise, IsStandardNormal) {
  std::vector<float> values = normals(PixelNoise(1, "a", 0));
  std::sort(values.begin(), values.end());
  double sum = 0.0, squares = 0.0, fourth = 0.0, distance = 0.0;
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double x = values[k];
    sum += x;
    squares += x * x;
    fourth += x * x * x * x;
    distance = std::max(distance, std::abs(phi(x) - (static_cast<double>(k) + 0.5) / kPixels));
  }
  const double n = kPixels;
  EXPECT_NEAR(sum / n, 0.0, 4.0 / std::sqrt(n));
  EXPECT_NEAR(squares / n, 1.0, 4.0 * std::sqrt(2.0 / n));
  EXPECT_NEAR(fourth / n, 3.0, 4.0 * std::sqrt(96.0 / n));
  // Kolmogorov and Smirnov at the 0.1 % level.
  EXPECT_LT(distance, 1.95 / std::sqrt(n));
}

TEST(PixelNoise, UniformNumbersFillTheirInterval) {
  std::vector<float> values(kPixels);
  PixelNoise(1, "a", 0).fill_uniform(0, 0, values);
  std::sort(values.begin(), values.end());
  EXPECT_GE(values.front(), 0.0F);
  EXPECT_LT(values.back(), 1.0F);
  double distance = 0.0;
  for (std::size_t k = 0; k < values.size(); ++k) {
    distance = std::max(
        distance, std::abs(double{values[k]} - (static_cast<double>(k) + 0.5) / kPixels));
  }
  EXPECT_LT(distance, 1.95 / std::sqrt(double{kPixels}));
}

TEST(PixelNoise, APixelsNumberDependsOnItsPlaceAlone) {
  const PixelNoise noise(5, "camera/depth", 12);
  const std::vector<float> all = normals(noise, 0, 1003);
  const std::vector<float> part = normals(noise, 0, 77, 400);
  for (std::size_t k = 0; k < part.size(); ++k) EXPECT_EQ(part[k], all[400 + k]);
}

TEST(PixelNoise, EveryKeyCounts) {
  const auto of = [](std::uint64_t seed, const char* sensor, std::uint64_t capture,
                     std::uint32_t layer) {
    return normals(PixelNoise(seed, sensor, capture), layer, 4096);
  };
  const std::vector<float> one = of(1, "a", 0, 0);
  EXPECT_EQ(of(1, "a", 0, 0), one);
  for (const auto& other : {of(2, "a", 0, 0), of(1, "b", 0, 0), of(1, "a", 1, 0),
                            of(1, "a", std::uint64_t{1} << 32, 0), of(1, "a", 0, 1)}) {
    double product = 0.0;
    for (std::size_t k = 0; k < one.size(); ++k) product += one[k] * other[k];
    EXPECT_NEAR(product / 4096.0, 0.0, 4.0 / 64.0) << "uncorrelated";
    EXPECT_NE(other, one);
  }
}

TEST(PixelNoise, PixelsComeInFours) {
  std::vector<float> values(8);
  EXPECT_THROW(PixelNoise(1, "a", 0).fill_normal(0, 2, values), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::sim
