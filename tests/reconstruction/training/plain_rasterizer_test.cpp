/// @file
/// The CPU rasterizer against plain_rasterizer.h, the oracle that the GPU's rasterizer is held
/// to (training_check): the two implementations then agree with each other.

#include "tests/reconstruction/training/plain_rasterizer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "tests/renderer/scenes.h"

namespace segsim::reconstruction {
namespace {

using testing::OwnedGradients;
using testing::OwnedImages;
using testing::OwnedSurfels;
using testing::PlainRasterizer;

/// Not a multiple of the tile, principal point off the centre, pixels not square.
const core::CameraIntrinsics kOddCamera{77, 61, 70.0, 64.0, 36.3, 31.8};

template <class Real>
double relative_error(const std::vector<Real>& a, const std::vector<double>& b) {
  double difference = 0.0, norm = 0.0;
  for (std::size_t i = 0; i < b.size(); ++i) {
    const double d = static_cast<double>(a[i]) - b[i];
    difference += d * d, norm += b[i] * b[i];
  }
  return norm > 0.0 ? std::sqrt(difference / norm) : std::sqrt(difference);
}

/// @param tolerance  Relative, in the Euclidean norm over all surfels or pixels.
template <class Real>
void expect_agreement(const OwnedSurfels<double>& surfels, const core::CameraPose& pose,
                      double tolerance) {
  const auto loss = testing::random_loss<double>(3, kOddCamera);
  OwnedImages<double> images(kOddCamera);
  OwnedGradients<double> gradients(surfels);
  std::vector<double> max_weight;
  std::vector<std::vector<PlainRasterizer<double>::Weight>> rows;
  PlainRasterizer<double>(surfels, kOddCamera, pose)
      .run(loss, images, gradients, max_weight, rows);

  const auto other = testing::converted<Real>(surfels);
  const auto other_loss = testing::random_loss<Real>(3, kOddCamera);
  OwnedImages<Real> other_images(kOddCamera);
  OwnedGradients<Real> other_gradients(other);
  std::vector<Real> other_max(max_weight.size());
  const auto cpu = make_cpu_rasterizer<Real>();
  cpu->forward(other.view(), kOddCamera, pose, other_images.view(), other_max.data());
  cpu->backward(other.view(), other_loss.const_view(), other_gradients.view());
  EXPECT_LT(relative_error(other_images.rgb, images.rgb), tolerance);
  EXPECT_LT(relative_error(other_images.depth_m, images.depth_m), tolerance);
  EXPECT_LT(relative_error(other_images.alpha, images.alpha), tolerance);
  EXPECT_LT(relative_error(other_images.normal, images.normal), tolerance);
  EXPECT_LT(relative_error(other_images.distortion, images.distortion), tolerance);
  EXPECT_LT(relative_error(other_max, max_weight), tolerance);
  EXPECT_LT(relative_error(other_gradients.position_m, gradients.position_m), tolerance);
  EXPECT_LT(relative_error(other_gradients.log_scale, gradients.log_scale), tolerance);
  EXPECT_LT(relative_error(other_gradients.rotation, gradients.rotation), tolerance);
  EXPECT_LT(relative_error(other_gradients.opacity_logit, gradients.opacity_logit), tolerance);
  EXPECT_LT(relative_error(other_gradients.sh, gradients.sh), tolerance);
  EXPECT_LT(relative_error(other_gradients.screen, gradients.screen), tolerance);
}

TEST(PlainRasterizer, CpuRasterizerInDoubleAgrees) {
  for (const int degree : {0, 3}) {
    expect_agreement<double>(testing::random_surfels<double>(11, 600, degree), {}, 1e-9);
  }
  expect_agreement<double>(
      testing::parameters_of<double>(renderer::testing::random_scene(10, 1500)),
      core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2}), 1e-9);
}

TEST(PlainRasterizer, CpuRasterizerInFloatAgrees) {
  expect_agreement<float>(testing::random_surfels<double>(12, 600, 2), {}, 1e-3);
}

}  // namespace
}  // namespace segsim::reconstruction
