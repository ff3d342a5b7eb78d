#include "sim/sensors/rgb_sensor.h"

#include <cmath>
#include <cstdlib>
#include <numeric>

#include <gtest/gtest.h>

#include "core/check.h"

namespace segsim::sim {
namespace {

using Rgb = core::Image<core::Rgb8>;

double linear(double code) {
  const double c = code / 255.0;
  return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
}

Rgb grey(std::uint8_t code, int width = 640, int height = 480) {
  return {width, height, {code, code, code}};
}

Rgb mean_of(const std::vector<Rgb>& images) {
  ExposureMean mean;
  for (const Rgb& image : images) mean.add(image);
  Rgb made;
  mean.finish(made);
  return made;
}

TEST(Exposure, OffsetsAreTheMiddlesOfEqualParts) {
  RgbModel model;
  EXPECT_EQ(model.exposure_offsets_s(), std::vector<double>{0.0});
  model.exposure_s = 0.03;
  EXPECT_EQ(model.exposure_offsets_s(), std::vector<double>{0.0}) << "one sub-pose: no blur";
  model.sub_poses = 3;
  const std::vector<double> three = model.exposure_offsets_s();
  ASSERT_EQ(three.size(), 3U);
  EXPECT_DOUBLE_EQ(three[0], -0.01);
  EXPECT_EQ(three[1], 0.0) << "exactly, so that the capture itself is one of them";
  EXPECT_DOUBLE_EQ(three[2], 0.01);
  model.sub_poses = 4;
  const std::vector<double> four = model.exposure_offsets_s();
  EXPECT_DOUBLE_EQ(four[0], -0.01125);
  EXPECT_NEAR(std::accumulate(four.begin(), four.end(), 0.0), 0.0, 1e-15);
}

TEST(Exposure, EveryCodeSurvivesTheMeanOfItself) {
  Rgb ramp(256, 1);
  for (int x = 0; x < 256; ++x) {
    const auto code = static_cast<std::uint8_t>(x);
    ramp(x, 0) = {code, static_cast<std::uint8_t>(255 - x), code};
  }
  EXPECT_EQ(mean_of({ramp}).pixels(), ramp.pixels());
  EXPECT_EQ(mean_of({ramp, ramp, ramp}).pixels(), ramp.pixels());
}

TEST(Exposure, LightIsAddedNotCodes) {
  // Half of white light is code 188 (0.5 in linear light), not 128.
  EXPECT_EQ(mean_of({grey(0, 2, 2), grey(255, 2, 2)})(1, 1).g, 188);
  // (0.0732 + 0.5271 + 0.8069) / 3 = 0.4691: code 182.
  const double expected = (linear(76) + linear(190) + linear(231)) / 3.0;
  const Rgb found = mean_of({grey(76, 2, 2), grey(190, 2, 2), grey(231, 2, 2)});
  EXPECT_LE(std::abs(linear(found(0, 0).r) - expected), linear(183) - linear(182));
}

TEST(Exposure, WantsImagesOfOneSize) {
  ExposureMean mean;
  mean.add(grey(1, 4, 4));
  EXPECT_THROW(mean.add(grey(1, 4, 5)), core::ContractViolation);
  Rgb made;
  EXPECT_THROW(ExposureMean().finish(made), core::ContractViolation);
}

struct Statistics {
  double mean = 0.0, deviation = 0.0;
};

/// Of the red channel in linear light.
Statistics linear_statistics(const Rgb& image) {
  Statistics s;
  for (const core::Rgb8 c : image.pixels()) s.mean += linear(c.r);
  s.mean /= static_cast<double>(image.size());
  for (const core::Rgb8 c : image.pixels()) {
    s.deviation += std::pow(linear(c.r) - s.mean, 2);
  }
  s.deviation = std::sqrt(s.deviation / static_cast<double>(image.size()));
  return s;
}

TEST(RgbNoise, FollowsShotAndReadNoise) {
  RgbModel model;
  model.full_well_e = 4000.0;
  model.read_noise_e = 12.0;
  for (const int code : {90, 150, 220}) {
    Rgb image = grey(static_cast<std::uint8_t>(code));
    add_rgb_noise(model, PixelNoise(1, "camera/rgb", 0), image);
    const Statistics found = linear_statistics(image);
    const double level = linear(code);
    const double sigma = std::sqrt(level / 4000.0 + (12.0 / 4000.0) * (12.0 / 4000.0));
    // Rounding to codes adds the variance of one step.
    const double step = linear(code + 1) - linear(code);
    const double expected = std::sqrt(sigma * sigma + step * step / 12.0);
    EXPECT_NEAR(found.deviation, expected, 0.02 * expected) << code;
    EXPECT_NEAR(found.mean, level, 4.0 * sigma / std::sqrt(640.0 * 480.0) + 0.02 * step)
        << code;
  }
}

TEST(RgbNoise, BlackHasReadNoiseAlone) {
  RgbModel model;
  model.full_well_e = 4000.0;
  Rgb image = grey(0);
  add_rgb_noise(model, PixelNoise(1, "camera/rgb", 0), image);
  EXPECT_EQ(image.pixels(), grey(0).pixels());
  model.read_noise_e = 12.0;
  add_rgb_noise(model, PixelNoise(1, "camera/rgb", 0), image);
  EXPECT_NE(image.pixels(), grey(0).pixels());
}

TEST(RgbNoise, IsOfTheCaptureAndNotOfTheImage) {
  RgbModel model;
  model.full_well_e = 1000.0;
  Rgb a = grey(128), b = grey(128), c = grey(128);
  add_rgb_noise(model, PixelNoise(1, "camera/rgb", 4), a);
  add_rgb_noise(model, PixelNoise(1, "camera/rgb", 4), b);
  add_rgb_noise(model, PixelNoise(1, "camera/rgb", 5), c);
  EXPECT_EQ(a.pixels(), b.pixels());
  EXPECT_NE(a.pixels(), c.pixels());
  Rgb untouched = grey(128);
  add_rgb_noise(RgbModel{}, PixelNoise(1, "camera/rgb", 4), untouched);
  EXPECT_EQ(untouched.pixels(), grey(128).pixels());
}

double mean_error(const Rgb& a, const Rgb& b) {
  double sum = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    sum += std::abs(a.pixels()[k].g - b.pixels()[k].g);
  }
  return sum / static_cast<double>(a.size());
}

TEST(Jpeg, LosesMoreAtLowerQuality) {
  Rgb picture(64, 48);
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x) {
      // Grey, so that the coarser grid of the colours plays no part.
      const auto code = static_cast<std::uint8_t>(100 + 2 * x + ((x / 5 + y / 7) % 2) * 20);
      picture(x, y) = {code, code, code};
    }
  }
  const auto compressed = [&](int quality) {
    RgbModel model;
    model.jpeg_quality = quality;
    Rgb image = picture;
    compress_jpeg(model, image);
    return image;
  };
  EXPECT_EQ(compressed(0).pixels(), picture.pixels()) << "not at all";
  const double fine = mean_error(compressed(95), picture);
  const double coarse = mean_error(compressed(20), picture);
  EXPECT_GT(fine, 0.0);
  EXPECT_LT(fine, 5.0);
  EXPECT_GT(coarse, 1.5 * fine);
  // Channels keep their places: one colour stays what it is.
  Rgb red(32, 32, {200, 30, 60});
  RgbModel model;
  model.jpeg_quality = 90;
  compress_jpeg(model, red);
  EXPECT_NEAR(red(16, 16).r, 200, 3);
  EXPECT_NEAR(red(16, 16).g, 30, 3);
  EXPECT_NEAR(red(16, 16).b, 60, 3);
}

}  // namespace
}  // namespace segsim::sim
