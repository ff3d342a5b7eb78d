/// @file
/// Every derivative of the rasterizer in double precision against central differences.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "tests/reconstruction/training/training_surfels.h"

namespace segsim::reconstruction {
namespace {

using testing::OwnedGradients;
using testing::OwnedImages;
using testing::OwnedSurfels;

/// Four tiles, the last ones cut by the image's edge.
const core::CameraIntrinsics kCamera{26, 21, 24.0, 23.0, 12.7, 10.4};

enum Image { kRgb, kDepth, kAlpha, kNormal, kDistortion, kAll };
constexpr std::array kImageNames = {"rgb", "depth", "alpha", "normal", "distortion", "all"};

/// Random derivatives of size 1 by one of the images, or by all; larger ones by the
/// distortion, whose values are small.
OwnedImages<double> loss_of(Image image) {
  OwnedImages<double> loss = testing::random_loss<double>(3, kCamera);
  const std::array planes = {&loss.rgb, &loss.depth_m, &loss.alpha, &loss.normal,
                             &loss.distortion};
  for (std::size_t k = 0; k < planes.size(); ++k) {
    const bool used = image == kAll || k == static_cast<std::size_t>(image);
    const double size = (used ? 1.0 : 0.0) * (k == kDistortion ? 100.0 : 1.0);
    for (double& value : *planes[k]) value *= size * static_cast<double>(loss.area());
  }
  return loss;
}

double sum_of_products(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

class GradientCheck {
 public:
  GradientCheck(OwnedSurfels<double> surfels, core::CameraPose T_world_camera)
      : surfels_(std::move(surfels)),
        T_world_camera_(T_world_camera),
        rasterizer_(make_cpu_rasterizer<double>({1})),
        images_(kCamera),
        loss_(kCamera) {}

  void run(Image image) {
    SCOPED_TRACE(kImageNames[image]);
    loss_ = loss_of(image);
    OwnedGradients<double> gradients(surfels_);
    evaluate();
    rasterizer_->backward(surfels_.view(), loss_.const_view(), gradients.view());
    compare("position", surfels_.position_m, gradients.position_m);
    compare("log_scale", surfels_.log_scale, gradients.log_scale);
    compare("rotation", surfels_.rotation, gradients.rotation);
    compare("opacity_logit", surfels_.opacity_logit, gradients.opacity_logit);
    compare("sh", surfels_.sh, gradients.sh);
  }

  [[nodiscard]] const OwnedImages<double>& images() const { return images_; }
  double largest = 0.0;  ///< Derivative met so far.

 private:
  double evaluate() {
    rasterizer_->forward(surfels_.view(), kCamera, T_world_camera_, images_.view(), nullptr);
    return sum_of_products(images_.rgb, loss_.rgb) +
           sum_of_products(images_.depth_m, loss_.depth_m) +
           sum_of_products(images_.alpha, loss_.alpha) +
           sum_of_products(images_.normal, loss_.normal) +
           sum_of_products(images_.distortion, loss_.distortion);
  }

  double difference(double& parameter, double step) {
    const double kept = parameter;
    parameter = kept + step;
    const double above = evaluate();
    parameter = kept - step;
    const double below = evaluate();
    parameter = kept;
    return (above - below) / (2.0 * step);
  }

  void compare(const std::string& name, std::vector<double>& parameters,
               const std::vector<double>& gradients) {
    double scale = 0.0;
    for (const double g : gradients) scale = std::max(scale, std::abs(g));
    largest = std::max(largest, scale);
    for (std::size_t i = 0; i < parameters.size(); ++i) {
      const double expected = difference(parameters[i], 1e-6);
      const double tolerance = 1e-5 * std::abs(expected) + 1e-6 * scale + 5e-9;
      EXPECT_NEAR(gradients[i], expected, tolerance) << name << " " << i;
    }
  }

  OwnedSurfels<double> surfels_;
  core::CameraPose T_world_camera_;
  std::unique_ptr<DifferentiableRasterizer<double>> rasterizer_;
  OwnedImages<double> images_, loss_;
};

/// A camera away from the origin, and the surfels with it.
core::CameraPose turned_pose() {
  return {glm::normalize(glm::dquat(0.9, 0.1, -0.3, 0.2)), {0.4, -1.1, 0.7}};
}

OwnedSurfels<double> moved_to(const core::CameraPose& pose, OwnedSurfels<double> surfels) {
  for (std::size_t i = 0; i < surfels.opacity_logit.size(); ++i) {
    double* p = &surfels.position_m[3 * i];
    const glm::dvec3 at =
        pose.rotation() * glm::dvec3(p[0], p[1], p[2]) + pose.translation_m();
    for (int k = 0; k < 3; ++k) p[k] = at[k];
    double* r = &surfels.rotation[4 * i];
    const glm::dquat q = pose.rotation() * glm::dquat(r[0], r[1], r[2], r[3]);
    r[0] = q.w, r[1] = q.x, r[2] = q.y, r[3] = q.z;
  }
  return surfels;
}

class RasterGradient : public ::testing::TestWithParam<Image> {};

TEST_P(RasterGradient, MatchesDifferencesForEveryDegree) {
  for (int degree = 0; degree <= 3; ++degree) {
    SCOPED_TRACE("degree " + std::to_string(degree));
    const core::CameraPose pose = turned_pose();
    GradientCheck check(
        moved_to(pose, testing::random_surfels<double>(11 + degree, 14, degree)), pose);
    check.run(GetParam());
    EXPECT_GT(check.largest, 1e-4);
  }
}

TEST_P(RasterGradient, MatchesDifferencesThroughTheNearPlane) {
  GradientCheck check(testing::near_plane_surfels<double>(), {});
  check.run(GetParam());
  EXPECT_GT(check.largest, 1e-4);
}

TEST_P(RasterGradient, MatchesDifferencesUnderTheLowPass) {
  GradientCheck check(testing::low_pass_surfels<double>(), {});
  check.run(GetParam());
  EXPECT_GT(check.largest, 1e-4);
}

TEST_P(RasterGradient, MatchesDifferencesWhereAlphaIsClamped) {
  GradientCheck check(testing::opaque_surfels<double>(), {});
  check.run(GetParam());
  EXPECT_GT(check.largest, 1e-4);
  // Some pixels are finished before the last surfel, which they do not blend.
  EXPECT_GE(*std::max_element(check.images().alpha.begin(), check.images().alpha.end()), 0.99);
}

TEST_P(RasterGradient, MatchesDifferencesEdgeOn) {
  GradientCheck check(testing::edge_on_surfels<double>(), {});
  check.run(GetParam());
  EXPECT_GT(check.largest, 1e-4);
}

INSTANTIATE_TEST_SUITE_P(Images, RasterGradient,
                         ::testing::Values(kRgb, kDepth, kAlpha, kNormal, kDistortion, kAll),
                         [](const auto& case_info) {
                           return std::string(kImageNames[case_info.param]);
                         });

/// Surfels with more coefficients than are in use: colours and derivatives ignore the rest.
TEST(RasterGradientDegrees, InactiveCoefficientsHaveNone) {
  OwnedSurfels<double> surfels = testing::random_surfels<double>(21, 10, 3);
  surfels.active_sh_degree = 1;
  GradientCheck check(surfels, {});
  check.run(kRgb);
  const auto rasterizer = make_cpu_rasterizer<double>({1});
  OwnedImages<double> images(kCamera);
  OwnedGradients<double> gradients(surfels);
  rasterizer->forward(surfels.view(), kCamera, {}, images.view(), nullptr);
  rasterizer->backward(surfels.view(), loss_of(kRgb).const_view(), gradients.view());
  double active = 0.0;
  for (std::size_t i = 0; i < gradients.sh.size(); ++i) {
    if (i % 48 < 12) {
      active = std::max(active, std::abs(gradients.sh[i]));
    } else {
      EXPECT_EQ(gradients.sh[i], 0.0);
    }
  }
  EXPECT_GT(active, 1e-5);
}

/// The screen statistic is the derivative by a movement of the whole surfel on the image,
/// which moving the principal point the other way is for a disc parallel to the image.
TEST(RasterGradientScreen, IsTheDerivativeByTheProjectedCentre) {
  core::RandomStream random(9, "screen");
  OwnedSurfels<double> surfels;
  add_raw(surfels, {{0.1, -0.05, 2.0}, {0.0, 0.0, 0.4}, 0.25, 0.2, 0.8, 1.0}, random);
  const OwnedImages<double> loss = loss_of(kRgb);
  const auto rasterizer = make_cpu_rasterizer<double>({1});
  OwnedImages<double> images(kCamera);
  const auto value = [&](double x_px, double y_px) {
    core::CameraIntrinsics camera = kCamera;
    camera.cx_px += x_px;
    camera.cy_px += y_px;
    rasterizer->forward(surfels.view(), camera, {}, images.view(), nullptr);
    return sum_of_products(images.rgb, loss.rgb);
  };
  const double step_px = 1e-6;
  const double by_x = (value(step_px, 0) - value(-step_px, 0)) / (2 * step_px);
  const double by_y = (value(0, step_px) - value(0, -step_px)) / (2 * step_px);
  const double expected =
      std::hypot(0.5 * kCamera.width_px * by_x, 0.5 * kCamera.height_px * by_y);
  OwnedGradients<double> gradients(surfels);
  value(0, 0);
  rasterizer->backward(surfels.view(), loss.const_view(), gradients.view());
  EXPECT_GT(expected, 1e-3);
  EXPECT_NEAR(gradients.screen[0], expected, 1e-6 * expected);
}

/// A loss by the colours of an image is one by the weights of its surfels, too: by w_k it is
/// that by the colour times the surfel's colour.
template <class Real>
void expect_weights_as_colours(const OwnedSurfels<Real>& surfels, Real tolerance) {
  const std::size_t area = OwnedImages<Real>(kCamera).area();
  std::vector<std::int32_t> pixels;
  for (std::size_t p = 0; p < area; p += 3) pixels.push_back(static_cast<std::int32_t>(p));
  pixels.push_back(pixels[40]);  // Twice.
  const OwnedImages<Real> random = testing::random_loss<Real>(4, kCamera);
  OwnedImages<Real> by_colour(kCamera), by_nothing(kCamera), images(kCamera);
  const auto rasterizer = make_cpu_rasterizer<Real>({1});
  rasterizer->forward(surfels.view(), kCamera, {}, images.view(), nullptr);
  const PixelWeights got =
      rasterizer->weights(pixels.data(), static_cast<std::int64_t>(pixels.size()), 0);
  const std::vector<std::int32_t> start(got.row_start, got.row_start + got.pixels + 1),
      surfel(got.surfel, got.surfel + got.entries);
  const std::vector<float> weight(got.weight, got.weight + got.entries);
  std::vector<float> by_weight;
  for (std::size_t row = 0; row < pixels.size(); ++row) {
    for (std::size_t c = 0; c < 3; ++c) {
      const std::size_t place = 3 * static_cast<std::size_t>(pixels[row]) + c;
      by_colour.rgb[place] += random.rgb[place];
    }
    for (auto e = static_cast<std::size_t>(start[row]);
         e < static_cast<std::size_t>(start[row + 1]); ++e) {
      Real sum = Real(0);
      for (std::size_t c = 0; c < 3; ++c) {
        const Real colour = Real(0.28209479177387814) *
                                surfels.sh[3 * static_cast<std::size_t>(surfel[e]) + c] +
                            Real(0.5);
        sum += std::max(Real(0), colour) *
               random.rgb[3 * static_cast<std::size_t>(pixels[row]) + c];
      }
      by_weight.push_back(static_cast<float>(sum));
    }
  }
  OwnedGradients<Real> expected(surfels), gradients(surfels), after(surfels);
  rasterizer->backward(surfels.view(), by_colour.const_view(), expected.view());
  rasterizer->add_weight_loss(
      pixels, {got.pixels, got.entries, start.data(), surfel.data(), weight.data()},
      by_weight.data());
  rasterizer->backward(surfels.view(), by_nothing.const_view(), gradients.view());
  const auto compare = [&](const char* name, const std::vector<Real>& a,
                           const std::vector<Real>& b) {
    Real scale = Real(0);
    for (const Real value : b) scale = std::max(scale, std::abs(value));
    EXPECT_GT(scale, Real(1e-5)) << name;
    for (std::size_t i = 0; i < a.size(); ++i) {
      EXPECT_NEAR(a[i], b[i], tolerance * scale) << name << ' ' << i;
    }
  };
  compare("position", gradients.position_m, expected.position_m);
  compare("log_scale", gradients.log_scale, expected.log_scale);
  compare("rotation", gradients.rotation, expected.rotation);
  compare("opacity_logit", gradients.opacity_logit, expected.opacity_logit);
  // It takes part once.
  rasterizer->backward(surfels.view(), by_nothing.const_view(), after.view());
  for (const Real value : after.position_m) EXPECT_EQ(value, Real(0));
}

TEST(RasterGradientWeights, AreThoseOfColours) {
  expect_weights_as_colours(testing::random_surfels<double>(31, 40, 0), 1e-6);
  expect_weights_as_colours(
      testing::converted<float>(testing::random_surfels<double>(31, 40, 0)), 2e-4F);
}

}  // namespace
}  // namespace segsim::reconstruction
