#include "reconstruction/evaluation/image_quality.h"

#include <cmath>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>

#include "core/check.h"
#include "core/random.h"

namespace segsim::reconstruction {
namespace {

using core::Rgb8;

core::Image<Rgb8> noise_image(int width_px, int height_px, std::uint64_t seed) {
  core::RandomStream random(seed, "image");
  core::Image<Rgb8> image(width_px, height_px);
  for (Rgb8& pixel : image.pixels()) {
    const auto byte = [&] { return static_cast<std::uint8_t>(random.index(256)); };
    pixel = {byte(), byte(), byte()};
  }
  return image;
}

/// Wang's formula, window by window, straight from the definition.
double slow_ssim(const core::Image<Rgb8>& a, const core::Image<Rgb8>& b, bool valid) {
  const double c1 = 6.5025, c2 = 58.5225;
  double total = 0.0, norm = 0.0;
  int count = 0;
  for (int i = -5; i <= 5; ++i) norm += std::exp(-i * i / 4.5);
  const int margin = valid ? 5 : 0;
  for (const auto channel : {&Rgb8::r, &Rgb8::g, &Rgb8::b}) {
    for (int y = margin; y < a.height_px() - margin; ++y) {
      for (int x = margin; x < a.width_px() - margin; ++x) {
        double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
        for (int j = -5; j <= 5; ++j) {
          for (int i = -5; i <= 5; ++i) {
            if (!a.contains(x + i, y + j)) continue;
            const double w = std::exp(-(i * i + j * j) / 4.5) / (norm * norm);
            const double va = a(x + i, y + j).*channel, vb = b(x + i, y + j).*channel;
            ma += w * va, mb += w * vb, aa += w * va * va, bb += w * vb * vb;
            ab += w * va * vb;
          }
        }
        total += (2 * ma * mb + c1) * (2 * (ab - ma * mb) + c2) /
                 ((ma * ma + mb * mb + c1) * (aa - ma * ma + bb - mb * mb + c2));
        ++count;
      }
    }
  }
  return total / count;
}

TEST(ImageQuality, PsnrOfAKnownDifference) {
  const core::Image<Rgb8> black(4, 3), grey(4, 3, Rgb8{16, 16, 16});
  EXPECT_NEAR(psnr_db(grey, black), 20.0 * std::log10(255.0 / 16.0), 1e-12);
  EXPECT_TRUE(std::isinf(psnr_db(grey, grey)));
  core::Image<Rgb8> one = black;
  one(2, 1).g = 255;  // One of 36 values.
  EXPECT_NEAR(psnr_db(one, black), 10.0 * std::log10(36.0), 1e-12);
}

TEST(ImageQuality, SsimEqualsItsDefinition) {
  const core::Image<Rgb8> a = noise_image(23, 17, 1);
  core::Image<Rgb8> b = noise_image(23, 17, 2);
  for (std::size_t i = 0; i < b.size(); i += 2) b.pixels()[i] = a.pixels()[i];
  EXPECT_NEAR(ssim(a, b), slow_ssim(a, b, false), 1e-9);
  EXPECT_NEAR(ssim(a, b, SsimBorder::kValid), slow_ssim(a, b, true), 1e-9);
  EXPECT_NEAR(ssim(a, a), 1.0, 1e-12);
}

TEST(ImageQuality, SsimOfImagesSmallerThanTheWindow) {
  const core::Image<Rgb8> a = noise_image(3, 2, 3), b = noise_image(3, 2, 4);
  EXPECT_NEAR(ssim(a, b), slow_ssim(a, b, false), 1e-9);
  EXPECT_THROW((void)ssim(a, b, SsimBorder::kValid), core::ContractViolation);
}

TEST(ImageQuality, SsimOfConstantImagesIsTheLuminanceTerm) {
  const core::Image<Rgb8> a(16, 16, Rgb8{100, 100, 100}), b(16, 16, Rgb8{120, 120, 120});
  EXPECT_NEAR(ssim(a, b, SsimBorder::kValid),
              (2.0 * 100 * 120 + 6.5025) / (100.0 * 100 + 120.0 * 120 + 6.5025), 1e-9);
}

TEST(ImageQuality, ColorIsAveragedOverViews) {
  const core::Image<Rgb8> black(12, 12), dim(12, 12, Rgb8{8, 8, 8}),
      grey(12, 12, Rgb8{16, 16, 16});
  ColorQuality quality;
  quality.add(dim, black);
  quality.add(grey, black);
  EXPECT_EQ(quality.views(), 2);
  EXPECT_NEAR(quality.psnr_db(), 0.5 * (psnr_db(dim, black) + psnr_db(grey, black)), 1e-12);
  EXPECT_NEAR(quality.ssim(), 0.5 * (ssim(dim, black) + ssim(grey, black)), 1e-12);
}

TEST(ImageQuality, DepthErrorSkipsWhatIsMissing) {
  const float none = std::numeric_limits<float>::quiet_NaN();
  core::Image<float> depth_m(5, 1), truth_m(5, 1);
  depth_m.pixels() = {1.1F, 2.0F, none, 3.0F, 2.0F};
  truth_m.pixels() = {1.0F, 2.0F, 2.0F, none, 1.0F};
  DepthQuality quality;
  quality.add(depth_m, truth_m);
  EXPECT_EQ(quality.pixels(), 3U);
  EXPECT_NEAR(quality.mean_abs_m(), 1.1 / 3.0, 1e-6);
  EXPECT_NEAR(quality.rms_m(), std::sqrt((0.01 + 1.0) / 3.0), 1e-6);
  EXPECT_NEAR(quality.mean_relative(), 1.1 / 3.0, 1e-6);
  EXPECT_NEAR(quality.within_1_25(), 2.0 / 3.0, 1e-12);
  EXPECT_NEAR(quality.completeness(), 3.0 / 4.0, 1e-12);
  EXPECT_EQ(DepthQuality().mean_abs_m(), 0.0);
}

TEST(ImageQuality, MedianDepthErrorIsThatOfTheMiddlePixel) {
  core::Image<float> depth_m(5, 1, 2.0F), truth_m(5, 1);
  truth_m.pixels() = {2.0F, 2.0105F, 1.9795F, 2.3F, 9.0F};  // Errors 0, 10.5, 20.5, 300, 7000.
  DepthQuality quality;
  quality.add(depth_m, truth_m);
  EXPECT_DOUBLE_EQ(quality.median_abs_m(), 0.020);
  EXPECT_EQ(DepthQuality().median_abs_m(), 0.0);
  DepthQuality far;
  far.add(core::Image<float>(2, 1, 1.0F), core::Image<float>(2, 1, 5.0F));
  EXPECT_DOUBLE_EQ(far.median_abs_m(), kMedianLimit_m);
}

TEST(ImageQuality, AFittedGainTakesOutTheExposureAndNothingElse) {
  core::Image<Rgb8> truth = noise_image(16, 12, 5);
  for (Rgb8& pixel : truth.pixels()) pixel.r /= 2, pixel.g /= 2, pixel.b /= 2;
  core::Image<Rgb8> darker = truth;
  for (Rgb8& pixel : darker.pixels()) {
    pixel.r = static_cast<std::uint8_t>(std::lround(0.7 * pixel.r));
    pixel.b = static_cast<std::uint8_t>(std::lround(1.4 * pixel.b));
  }
  // What rounding to bytes leaves.
  EXPECT_GT(psnr_db(gain_fitted(darker, truth), truth), 48.0);
  EXPECT_LT(psnr_db(darker, truth), 30.0);

  const core::Image<Rgb8> other = noise_image(16, 12, 6);
  EXPECT_GE(psnr_db(gain_fitted(other, truth), truth), psnr_db(other, truth));
  const core::Image<Rgb8> black(16, 12);
  EXPECT_EQ(gain_fitted(black, truth).pixels(), black.pixels());
}

TEST(ImageQuality, AnExposureIsAGainAndAnOffsetOfEachChannel) {
  const core::Image<Rgb8> image(1, 1, Rgb8{100, 200, 50});
  const Exposure exposure{.gain = {0.5F, 2.0F, 1.0F}, .offset = {0.1F, 0.0F, -0.3F}};
  EXPECT_EQ(exposed(image, exposure)(0, 0), (Rgb8{76, 255, 0}));  // 50 + 25.5, cut, cut.
  EXPECT_EQ(exposed(image, {})(0, 0), image(0, 0));
}

TEST(ImageQuality, NormalErrorIsTheAngle) {
  const auto tilted = [](double degrees) {
    const double angle_rad = degrees * std::numbers::pi / 180.0;
    return glm::vec3(std::sin(angle_rad), 0.0, std::cos(angle_rad));
  };
  core::Image<glm::vec3> normal(4, 1), truth(4, 1, glm::vec3(0, 0, 1));
  normal.pixels() = {tilted(0.0), tilted(20.0), tilted(100.0), glm::vec3(0.0F)};
  NormalQuality quality;
  quality.add(normal, truth);
  EXPECT_EQ(quality.pixels(), 3U);
  EXPECT_NEAR(quality.mean_rad(), 40.0 * std::numbers::pi / 180.0, 1e-6);
  EXPECT_NEAR(quality.within()[0], 1.0 / 3.0, 1e-12);
  EXPECT_NEAR(quality.within()[1], 2.0 / 3.0, 1e-12);
  EXPECT_NEAR(quality.within()[2], 2.0 / 3.0, 1e-12);
}

TEST(ImageQuality, RefusesDifferentSizes) {
  EXPECT_THROW((void)psnr_db(core::Image<Rgb8>(2, 2), core::Image<Rgb8>(2, 3)),
               core::ContractViolation);
}

}  // namespace
}  // namespace segsim::reconstruction
