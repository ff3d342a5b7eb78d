/// @file
/// Every instruction set finds the images and derivatives of double precision. Highway chooses
/// among the sets of the processor; its portable one, which this processor would never choose,
/// is compiled into a test of its own from the same file (SEGSIM_ONLY_TARGET names it).

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include <hwy/targets.h>

#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "renderer/scene/simd_target.h"
#include "tests/reconstruction/training/training_surfels.h"

namespace segsim::reconstruction {
namespace {

using testing::OwnedGradients;
using testing::OwnedImages;
using testing::OwnedSurfels;

const core::CameraIntrinsics kCamera{75, 52, 60.0, 58.0, 36.3, 27.1};

template <class Real>
struct Result {
  OwnedImages<Real> images;
  OwnedGradients<Real> gradients;
  std::vector<Real> max_weight;
};

/// Surfels and derivatives are rounded to float for either type.
template <class Real>
Result<Real> result_of(const OwnedSurfels<float>& narrow_surfels, std::uint64_t seed,
                       bool distortion) {
  const auto surfels = testing::converted<Real>(narrow_surfels);
  const OwnedImages<float> narrow = testing::random_loss<float>(seed, kCamera);
  OwnedImages<Real> loss(kCamera);
  loss.rgb.assign(narrow.rgb.begin(), narrow.rgb.end());
  loss.depth_m.assign(narrow.depth_m.begin(), narrow.depth_m.end());
  loss.alpha.assign(narrow.alpha.begin(), narrow.alpha.end());
  loss.normal.assign(narrow.normal.begin(), narrow.normal.end());
  if (distortion) loss.distortion.assign(narrow.distortion.begin(), narrow.distortion.end());
  Result<Real> result{OwnedImages<Real>(kCamera), OwnedGradients<Real>(surfels),
                      std::vector<Real>(surfels.opacity_logit.size())};
  const auto rasterizer = make_cpu_rasterizer<Real>({1});
  rasterizer->forward(surfels.view(), kCamera, {}, result.images.view(),
                      result.max_weight.data());
  rasterizer->backward(surfels.view(), loss.const_view(), result.gradients.view());
  return result;
}

/// |a - b| / |b|
double difference(const std::vector<float>& a, const std::vector<double>& b) {
  double difference = 0.0, size = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = static_cast<double>(a[i]) - b[i];
    difference += d * d;
    size += b[i] * b[i];
  }
  EXPECT_GT(size, 0.0);
  return std::sqrt(difference / size);
}

void expect_double_precision(const OwnedSurfels<float>& surfels, std::uint64_t seed) {
  for (const bool distortion : {false, true}) {
    const Result<float> a = result_of<float>(surfels, seed, distortion);
    const Result<double> b = result_of<double>(surfels, seed, distortion);
    EXPECT_LT(difference(a.images.rgb, b.images.rgb), 3e-5);
    EXPECT_LT(difference(a.images.depth_m, b.images.depth_m), 1e-4);
    EXPECT_LT(difference(a.images.alpha, b.images.alpha), 3e-5);
    EXPECT_LT(difference(a.images.normal, b.images.normal), 3e-5);
    EXPECT_LT(difference(a.images.median_m, b.images.median_m), 1e-4);
    EXPECT_LT(difference(a.images.distortion, b.images.distortion), 1e-3);
    EXPECT_LT(difference(a.max_weight, b.max_weight), 1e-5);
    EXPECT_LT(difference(a.gradients.position_m, b.gradients.position_m), 1e-3);
    EXPECT_LT(difference(a.gradients.log_scale, b.gradients.log_scale), 1e-3);
    EXPECT_LT(difference(a.gradients.rotation, b.gradients.rotation), 1e-3);
    EXPECT_LT(difference(a.gradients.opacity_logit, b.gradients.opacity_logit), 1e-3);
    EXPECT_LT(difference(a.gradients.sh, b.gradients.sh), 1e-3);
  }
}

void expect_double_precision() {
  for (const std::uint64_t seed : {41, 42}) {
    expect_double_precision(testing::random_surfels<float>(seed, 500, 1), seed);
  }
  const auto expect_special = [](const char* name, const OwnedSurfels<float>& surfels) {
    SCOPED_TRACE(name);
    expect_double_precision(surfels, 43);
  };
  expect_special("near plane", testing::near_plane_surfels<float>());
  expect_special("low pass", testing::low_pass_surfels<float>());
  expect_special("opaque", testing::opaque_surfels<float>());
  expect_special("edge on", testing::edge_on_surfels<float>());
}

#ifdef SEGSIM_ONLY_TARGET

TEST(RasterTargets, PortableOneIsNearDoublePrecision) {
  ASSERT_EQ(renderer::simd_target(), SEGSIM_ONLY_TARGET);
  expect_double_precision();
}

#else

TEST(RasterTargets, OfThisProcessorAreNearDoublePrecision) {
  const std::int64_t all = hwy::SupportedTargets() & HWY_TARGETS;
  int tried = 0;
  for (std::int64_t left = all; left != 0; left &= left - 1) {
    const std::int64_t target = left & -left;
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    expect_double_precision();
    ++tried;
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  EXPECT_GT(tried, 1);
}

#endif

}  // namespace
}  // namespace segsim::reconstruction
