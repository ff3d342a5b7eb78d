/// @file
/// The rasterizer's images and weights against the blending oracle, the inference renderer and
/// each other; float against double; any number of threads.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/check.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "renderer/cpu_renderer.h"
#include "tests/reconstruction/training/training_surfels.h"
#include "tests/renderer/blending_oracle.h"
#include "tests/renderer/scenes.h"

namespace segsim::reconstruction {
namespace {

using testing::OwnedGradients;
using testing::OwnedImages;
using testing::OwnedSurfels;

/// Tiles at the right and the bottom are cut by the image's edge.
const core::CameraIntrinsics kCamera{75, 52, 60.0, 58.0, 36.3, 27.1};

core::CameraPose inside_the_box() { return core::look_at({0.3, -0.2, 0.1}, {2.0, 1.0, 0.4}); }

/// A scene of awkward discs, with colours of degree 2.
renderer::SurfelCloud awkward_scene(std::uint64_t seed, int count) {
  renderer::SurfelCloud cloud = renderer::testing::random_scene(seed, count);
  core::RandomStream random(seed, "colours");
  std::vector<glm::vec3> sh;
  for (const glm::vec3& dc : cloud.sh) {
    sh.push_back(dc);
    for (int k = 1; k < 9; ++k) {
      for (int c = 0; c < 3; ++c) {
        if (c == 0) sh.emplace_back();
        sh.back()[c] = 0.3F * static_cast<float>(random.normal());
      }
    }
  }
  cloud.sh = std::move(sh);
  cloud.sh_degree = 2;
  return cloud;
}

/// The definition in surfel_parameters.h.
double distortion_of(const renderer::testing::OraclePixel& pixel) {
  const auto m = [](double z) { return 100.0 / (100.0 - 0.2) * (1.0 - 0.2 / z); };
  double sum = 0.0;
  for (std::size_t i = 0; i < pixel.contributors.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const auto &a = pixel.contributors[i], &b = pixel.contributors[j];
      const double difference = m(a.depth_m) - m(b.depth_m);
      sum += a.weight * b.weight * difference * difference;
    }
  }
  return sum;
}

struct Worst {
  double rgb = 0, depth_m = 0, alpha = 0, normal = 0, median_m = 0, distortion = 0;
  int pixels = 0, medians = 0;
};

template <class Real>
Worst compare_with_oracle(std::uint64_t seed) {
  const auto cloud = std::make_shared<const renderer::SurfelCloud>(awkward_scene(seed, 900));
  const OwnedSurfels<Real> surfels = testing::parameters_of<Real>(*cloud);
  const renderer::testing::BlendingOracle oracle(cloud, inside_the_box(), kCamera);
  OwnedImages<Real> images(kCamera);
  make_cpu_rasterizer<Real>({1})->forward(surfels.view(), kCamera, inside_the_box(),
                                          images.view(), nullptr);
  Worst worst;
  const auto raise = [](double& to, double a, Real b) {
    to = std::max(to, std::abs(a - static_cast<double>(b)));
  };
  for (int y = 0; y < kCamera.height_px; ++y) {
    for (int x = 0; x < kCamera.width_px; ++x) {
      const renderer::testing::OraclePixel expected = oracle.pixel(x, y);
      if (!expected.certain) continue;
      ++worst.pixels;
      const auto p = static_cast<std::size_t>(y * kCamera.width_px + x);
      double depth_m = 0.0;
      for (const auto& c : expected.contributors) depth_m += c.weight * c.depth_m;
      for (int k = 0; k < 3; ++k) {
        raise(worst.rgb, expected.colour[k], images.rgb[3 * p + k]);
        raise(worst.normal, expected.normal[k], images.normal[3 * p + k]);
      }
      raise(worst.depth_m, depth_m, images.depth_m[p]);
      raise(worst.alpha, 1.0 - expected.transmittance, images.alpha[p]);
      raise(worst.distortion, distortion_of(expected), images.distortion[p]);
      if (!expected.depth_certain) continue;
      ++worst.medians;
      const bool surface = expected.transmittance <= 0.5;
      raise(worst.median_m, surface ? expected.median_depth_m : 0.0, images.median_m[p]);
    }
  }
  return worst;
}

TEST(RasterForward, DoubleMatchesTheOracle) {
  // Quaternions of the cloud have the length of floats, so edges move by 1e-7.
  const Worst worst = compare_with_oracle<double>(1);
  EXPECT_GT(worst.pixels, 3000);
  EXPECT_GT(worst.medians, 3000);
  EXPECT_LT(worst.rgb, 1e-6);
  EXPECT_LT(worst.depth_m, 1e-5);
  EXPECT_LT(worst.alpha, 1e-6);
  EXPECT_LT(worst.normal, 1e-6);
  EXPECT_LT(worst.median_m, 1e-5);
  EXPECT_LT(worst.distortion, 1e-6);
}

TEST(RasterForward, FloatMatchesTheOracle) {
  const Worst worst = compare_with_oracle<float>(2);
  EXPECT_GT(worst.pixels, 3000);
  EXPECT_GT(worst.medians, 3000);
  EXPECT_LT(worst.rgb, 1e-4);
  EXPECT_LT(worst.depth_m, 3e-4);
  EXPECT_LT(worst.alpha, 1e-4);
  EXPECT_LT(worst.normal, 1e-4);
  EXPECT_LT(worst.median_m, 1e-3);
  EXPECT_LT(worst.distortion, 1e-5);
}

/// A room of opaque surfels, as in training.
TEST(RasterForward, FloatMatchesTheInferenceRenderer) {
  const auto cloud =
      std::make_shared<const renderer::SurfelCloud>(renderer::testing::room_scene(0.06F));
  const auto camera = core::CameraIntrinsics::from_fov(160, 120, 1.2);
  const core::CameraPose pose = core::look_at({3.0, 2.4, 1.3}, {0.5, 1.0, 0.8});
  renderer::RenderOptions options;
  options.depth = renderer::DepthMode::kExpected;
  const core::Frame frame =
      renderer::make_cpu_renderer(cloud, options)->render(pose, camera, core::Channels::kAll);
  const OwnedSurfels<float> surfels = testing::parameters_of<float>(*cloud);
  OwnedImages<float> images(camera);
  make_cpu_rasterizer<float>()->forward(surfels.view(), camera, pose, images.view(), nullptr);
  double alpha = 0, depth_m = 0, normal = 0, levels = 0;
  int surfaces = 0;
  for (int y = 0; y < camera.height_px; ++y) {
    for (int x = 0; x < camera.width_px; ++x) {
      const auto p = static_cast<std::size_t>(y * camera.width_px + x);
      const auto error = [](float a, float b) { return static_cast<double>(std::abs(a - b)); };
      alpha += error(frame.alpha(x, y), images.alpha[p]);
      levels += std::abs(static_cast<double>(frame.rgb(x, y).g) -
                         255.0 * std::min(1.0, static_cast<double>(images.rgb[3 * p + 1])));
      if (!(images.alpha[p] > 0.6F)) continue;
      ++surfaces;
      depth_m += error(frame.depth_m(x, y), images.depth_m[p] / images.alpha[p]);
      const glm::vec3 n(images.normal[3 * p], images.normal[3 * p + 1],
                        images.normal[3 * p + 2]);
      normal += static_cast<double>(glm::length(frame.normal(x, y) - glm::normalize(n)));
    }
  }
  EXPECT_GT(surfaces, 19000);
  EXPECT_LT(alpha / surfaces, 1e-5);
  EXPECT_LT(depth_m / surfaces, 1e-5);
  EXPECT_LT(normal / surfaces, 1e-5);
  EXPECT_LT(levels / surfaces, 0.26);  // Rounding to a level costs 0.25 in the mean.
}

double relative_difference(const std::vector<float>& a, const std::vector<double>& b) {
  double difference = 0.0, size = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = static_cast<double>(a[i]) - b[i];
    difference += d * d;
    size += b[i] * b[i];
  }
  EXPECT_GT(size, 0.0);
  return std::sqrt(difference / size);
}

template <class Real>
OwnedGradients<Real> gradients_of(const OwnedSurfels<Real>& surfels,
                                  const OwnedImages<Real>& loss, int threads) {
  const auto rasterizer = make_cpu_rasterizer<Real>({threads});
  OwnedImages<Real> images(kCamera);
  rasterizer->forward(surfels.view(), kCamera, {}, images.view(), nullptr);
  OwnedGradients<Real> gradients(surfels);
  rasterizer->backward(surfels.view(), loss.const_view(), gradients.view());
  return gradients;
}

TEST(RasterGradients, FloatIsNearDouble) {
  const OwnedSurfels<double> surfels = testing::random_surfels<double>(31, 400, 3);
  const OwnedSurfels<float> narrow = testing::converted<float>(surfels);
  OwnedImages<float> loss = testing::random_loss<float>(4, kCamera);
  for (const bool distortion : {true, false}) {
    if (!distortion) std::fill(loss.distortion.begin(), loss.distortion.end(), 0.0F);
    OwnedImages<double> wide_loss(kCamera);
    const auto widen = [](const std::vector<float>& from, std::vector<double>& to) {
      to.assign(from.begin(), from.end());
    };
    widen(loss.rgb, wide_loss.rgb), widen(loss.depth_m, wide_loss.depth_m);
    widen(loss.alpha, wide_loss.alpha), widen(loss.normal, wide_loss.normal);
    widen(loss.distortion, wide_loss.distortion);
    const OwnedGradients<float> a = gradients_of(narrow, loss, 1);
    // The same surfels, rounded to float.
    const OwnedGradients<double> b =
        gradients_of(testing::converted<double>(narrow), wide_loss, 1);
    EXPECT_LT(relative_difference(a.position_m, b.position_m), 2e-4);
    EXPECT_LT(relative_difference(a.log_scale, b.log_scale), 2e-4);
    EXPECT_LT(relative_difference(a.rotation, b.rotation), 2e-4);
    EXPECT_LT(relative_difference(a.opacity_logit, b.opacity_logit), 2e-4);
    EXPECT_LT(relative_difference(a.sh, b.sh), 2e-4);
    EXPECT_LT(relative_difference(a.screen, b.screen), 2e-4);
  }
}

TEST(RasterGradients, DoNotDependOnTheThreads) {
  const OwnedSurfels<float> surfels = testing::random_surfels<float>(32, 3000, 1);
  const OwnedImages<float> loss = testing::random_loss<float>(5, kCamera);
  const OwnedGradients<float> expected = gradients_of(surfels, loss, 1);
  for (const int threads : {2, 3, 7}) {
    for (int repeat = 0; repeat < 3; ++repeat) {
      const OwnedGradients<float> found = gradients_of(surfels, loss, threads);
      EXPECT_EQ(found.position_m, expected.position_m);
      EXPECT_EQ(found.log_scale, expected.log_scale);
      EXPECT_EQ(found.rotation, expected.rotation);
      EXPECT_EQ(found.opacity_logit, expected.opacity_logit);
      EXPECT_EQ(found.sh, expected.sh);
      EXPECT_EQ(found.screen, expected.screen);
    }
  }
}

TEST(RasterGradients, AreZeroForSurfelsThatAreNotSeen) {
  OwnedSurfels<float> surfels = testing::random_surfels<float>(33, 4, 2);
  surfels.position_m[2] = -1.0F;     // Behind the camera.
  surfels.opacity_logit[1] = -7.0F;  // Too faint.
  surfels.position_m[6] = 100.0F;    // Beside the image.
  surfels.log_scale[6] = surfels.log_scale[7] = -2.0F;
  const OwnedGradients<float> found =
      gradients_of(surfels, testing::random_loss<float>(6, kCamera), 1);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(found.opacity_logit[i], 0.0F);
    EXPECT_EQ(found.screen[i], 0.0F);
    for (std::size_t k = 0; k < 27; ++k) EXPECT_EQ(found.sh[27 * i + k], 0.0F);
    for (std::size_t k = 0; k < 4; ++k) EXPECT_EQ(found.rotation[4 * i + k], 0.0F);
  }
  EXPECT_NE(found.opacity_logit[3], 0.0F);
}

/// All pixels, last one first.
std::vector<std::int32_t> all_pixels() {
  std::vector<std::int32_t> pixels;
  for (int p = kCamera.width_px * kCamera.height_px; p-- > 0;) pixels.push_back(p);
  return pixels;
}

TEST(RasterWeights, SumToAlphaAndExplainTheLargest) {
  const OwnedSurfels<float> surfels = testing::random_surfels<float>(34, 800, 0);
  for (const int threads : {1, 3}) {
    const auto rasterizer = make_cpu_rasterizer<float>({threads});
    OwnedImages<float> images(kCamera);
    std::vector<float> max_weight(800, 5.0F), largest(800, 0.0F);
    rasterizer->forward(surfels.view(), kCamera, {}, images.view(), max_weight.data());
    const std::vector<std::int32_t> pixels = all_pixels();
    const auto count = static_cast<std::int64_t>(pixels.size());
    const PixelWeights weights = rasterizer->weights(pixels.data(), count, 0);
    ASSERT_EQ(weights.pixels, count);
    ASSERT_EQ(weights.row_start[count], weights.entries);
    EXPECT_GT(weights.entries, 3 * count);
    for (std::int64_t row = 0; row < count; ++row) {
      double alpha = 0.0, red = 0.0;
      for (std::int32_t k = weights.row_start[row]; k < weights.row_start[row + 1]; ++k) {
        const auto surfel = static_cast<std::size_t>(weights.surfel[k]);
        const double w = static_cast<double>(weights.weight[k]);
        EXPECT_GT(w, 0.0);
        alpha += w;
        red +=
            w *
            std::max(0.0, 0.5 + static_cast<double>(renderer::kShC0 * surfels.sh[3 * surfel]));
        largest[surfel] = std::max(largest[surfel], weights.weight[k]);
      }
      const auto pixel = static_cast<std::size_t>(pixels[static_cast<std::size_t>(row)]);
      EXPECT_NEAR(alpha, static_cast<double>(images.alpha[pixel]), 1e-5);
      EXPECT_NEAR(red, static_cast<double>(images.rgb[3 * pixel]), 1e-5);
    }
    for (std::size_t i = 0; i < largest.size(); ++i) {
      EXPECT_NEAR(max_weight[i], largest[i], 1e-5F);
      EXPECT_EQ(max_weight[i] == 0.0F, largest[i] == 0.0F);
    }
  }
}

TEST(RasterWeights, KeepTheHeaviestFrontToBack) {
  const OwnedSurfels<float> surfels = testing::random_surfels<float>(35, 800, 0);
  const auto rasterizer = make_cpu_rasterizer<float>({1});
  OwnedImages<float> images(kCamera);
  rasterizer->forward(surfels.view(), kCamera, {}, images.view(), nullptr);
  const std::vector<std::int32_t> pixels{700, 3, 1500};
  const PixelWeights all = rasterizer->weights(pixels.data(), 3, 0);
  const std::vector<std::int32_t> start(all.row_start, all.row_start + 4);
  const std::vector<std::int32_t> surfel(all.surfel, all.surfel + all.entries);
  const std::vector<float> weight(all.weight, all.weight + all.entries);
  const PixelWeights few = rasterizer->weights(pixels.data(), 3, 4);
  for (std::size_t row = 0; row < 3; ++row) {
    std::vector<float> sorted(weight.begin() + start[row], weight.begin() + start[row + 1]);
    ASSERT_GT(sorted.size(), 4U);
    std::sort(sorted.begin(), sorted.end(), std::greater<>());
    std::vector<std::int32_t> expected;
    for (std::int32_t k = start[row]; k < start[row + 1]; ++k) {
      if (weight[static_cast<std::size_t>(k)] >= sorted[3]) {
        expected.push_back(surfel[static_cast<std::size_t>(k)]);
      }
    }
    EXPECT_EQ(expected, std::vector<std::int32_t>(few.surfel + few.row_start[row],
                                                  few.surfel + few.row_start[row + 1]));
  }
  EXPECT_EQ(rasterizer->weights(nullptr, 0, 4).entries, 0);
}

TEST(RasterInput, AnEmptySceneIsBlack) {
  const OwnedSurfels<float> surfels;
  const auto rasterizer = make_cpu_rasterizer<float>();
  OwnedImages<float> images(kCamera);
  std::fill(images.rgb.begin(), images.rgb.end(), 3.0F);
  rasterizer->forward(surfels.view(), kCamera, {}, images.view(), nullptr);
  EXPECT_EQ(*std::max_element(images.rgb.begin(), images.rgb.end()), 0.0F);
  OwnedGradients<float> gradients(surfels);
  rasterizer->backward(surfels.view(), images.const_view(), gradients.view());
}

/// What an optimiser that diverged leaves behind does not reach the image.
TEST(RasterInput, SurfelsThatAreNotNumbersAreNotDrawn) {
  OwnedSurfels<float> surfels = testing::random_surfels<float>(36, 6, 0);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  surfels.position_m[0] = nan;
  surfels.log_scale[2] = nan;
  surfels.log_scale[4] = std::numeric_limits<float>::infinity();
  for (int k = 0; k < 4; ++k) surfels.rotation[12 + k] = 0.0F;
  surfels.opacity_logit[4] = nan;
  OwnedSurfels<float> last = surfels;
  last.position_m.erase(last.position_m.begin(), last.position_m.begin() + 15);
  last.log_scale.erase(last.log_scale.begin(), last.log_scale.begin() + 10);
  last.rotation.erase(last.rotation.begin(), last.rotation.begin() + 20);
  last.opacity_logit.erase(last.opacity_logit.begin(), last.opacity_logit.begin() + 5);
  last.sh.erase(last.sh.begin(), last.sh.begin() + 15);
  const auto rasterizer = make_cpu_rasterizer<float>();
  OwnedImages<float> found(kCamera), expected(kCamera);
  rasterizer->forward(surfels.view(), kCamera, {}, found.view(), nullptr);
  rasterizer->forward(last.view(), kCamera, {}, expected.view(), nullptr);
  EXPECT_EQ(found.rgb, expected.rgb);
  EXPECT_GT(*std::max_element(found.alpha.begin(), found.alpha.end()), 0.01F);
}

TEST(RasterInput, BrokenCallsAreRefused) {
  const OwnedSurfels<float> surfels = testing::random_surfels<float>(37, 5, 1);
  OwnedImages<float> images(kCamera);
  OwnedGradients<float> gradients(surfels);
  const auto rasterizer = make_cpu_rasterizer<float>();
  const std::int32_t pixel = 0;
  const auto forward = [&](const SurfelParameters<float>& s, const TrainingImages<float>& i) {
    rasterizer->forward(s, kCamera, {}, i, nullptr);
  };
  EXPECT_THROW(make_cpu_rasterizer<float>({-1}), core::ContractViolation);
  EXPECT_THROW(rasterizer->backward(surfels.view(), images.const_view(), gradients.view()),
               core::ContractViolation);
  EXPECT_THROW((void)rasterizer->weights(&pixel, 1, 0), core::ContractViolation);

  SurfelParameters<float> broken = surfels.view();
  broken.rotation = nullptr;
  EXPECT_THROW(forward(broken, images.view()), core::ContractViolation);
  broken = surfels.view();
  broken.active_sh_degree = 2;
  EXPECT_THROW(forward(broken, images.view()), core::ContractViolation);
  TrainingImages<float> small = images.view();
  --small.width_px;
  EXPECT_THROW(forward(surfels.view(), small), core::ContractViolation);
  TrainingImages<float> missing = images.view();
  missing.alpha = nullptr;
  EXPECT_THROW(forward(surfels.view(), missing), core::ContractViolation);

  TrainingImages<float> no_distortion = images.view();
  no_distortion.distortion = nullptr;
  forward(surfels.view(), no_distortion);
  SurfelGradients<float> null = gradients.view();
  null.sh = nullptr;
  EXPECT_THROW(rasterizer->backward(surfels.view(), images.const_view(), null),
               core::ContractViolation);
  broken = surfels.view();
  broken.count = 4;
  EXPECT_THROW(rasterizer->backward(broken, images.const_view(), gradients.view()),
               core::ContractViolation);
  const std::int32_t outside = kCamera.width_px * kCamera.height_px;
  EXPECT_THROW((void)rasterizer->weights(&outside, 1, 0), core::ContractViolation);
  EXPECT_THROW((void)rasterizer->weights(&pixel, 1, -1), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::reconstruction
