#include "reconstruction/labels/internal/attention.h"

#include <gtest/gtest.h>

#include <array>

#include "core/random.h"
#include "reconstruction/labels/internal/head_support.h"
#include "tests/reconstruction/training/finite_differences.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::reconstruction {
namespace {

using internal::LabelSettings;
using internal::query_labels;
using internal::query_labels_unfused;
using internal::squared_distances;
using testing::expect_derivatives;
using testing::random_tensor;
using Inputs = std::vector<at::Tensor>;

constexpr std::array kVariants{renderer::LabelVariant::kTemperature,
                               renderer::LabelVariant::kNormalised,
                               renderer::LabelVariant::kLogSoftmax,
                               renderer::LabelVariant::kRaw, renderer::LabelVariant::kLiteral};

/// A model as the tensors that training has.
struct ModelTensors {
  explicit ModelTensors(const renderer::PanopticModel& model) {
    std::vector<float> p, s, r, f;
    for (const renderer::InstanceQuery& q : model.queries) {
      p.insert(p.end(), {q.position_m.x, q.position_m.y, q.position_m.z});
      s.insert(s.end(), {std::log(q.sigma_m.x), std::log(q.sigma_m.y), std::log(q.sigma_m.z)});
      // Any length stands for the same rotation.
      const glm::quat turned = 1.7F * q.R_world_query;
      r.insert(r.end(), {turned.w, turned.x, turned.y, turned.z});
      f.insert(f.end(), q.feature.begin(), q.feature.end());
    }
    position_m = tensor(p, 3), log_sigma = tensor(s, 3), rotation = tensor(r, 4);
    feature = tensor(f, 32);
  }
  static at::Tensor tensor(const std::vector<float>& values, std::int64_t columns) {
    return internal::device_tensor(values, torch::kFloat32, torch::kCPU).view({-1, columns});
  }
  at::Tensor position_m, log_sigma, rotation, feature;
};

at::Tensor features_of(const renderer::SurfelCloud& cloud) {
  std::vector<float> f;
  for (const auto& row : cloud.instance_feature) f.insert(f.end(), row.begin(), row.end());
  return ModelTensors::tensor(f, 32);
}

TEST(Attention, TrainingAndFoldingComputeTheSameLabels) {
  renderer::SurfelCloud cloud = renderer::testing::random_scene(5, 400);
  renderer::testing::add_random_features(cloud, 9);
  for (const renderer::LabelVariant variant : kVariants) {
    SCOPED_TRACE(static_cast<int>(variant));
    renderer::PanopticModel model = renderer::testing::random_model(3, 4, 20, 0.2F, 1.0);
    model.variant = variant;
    model.none_score = 0.07F;
    const ModelTensors t(model);
    const at::Tensor labels = query_labels(
        features_of(cloud).matmul(t.feature.t()),
        squared_distances(internal::positions_tensor(cloud.position_m, torch::kCPU),
                          t.position_m, t.log_sigma, t.rotation),
        {variant, static_cast<double>(model.none_score),
         static_cast<double>(model.temperature)});
    const renderer::PanopticField field = renderer::fold_panoptic_model(
        cloud, model, {.max_classes = 4, .max_instances = 21, .min_excess = 0.0F});
    double worst = 0.0, largest = 0.0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      std::vector<double> p(21, static_cast<double>(field.instances.base(i)));
      for (const auto& entry : field.instances.row(i)) {
        p[entry.index] += static_cast<double>(entry.excess);
      }
      double sum = 0.0;
      for (std::size_t q = 0; q < 20; ++q) {
        const double trained =
            labels[static_cast<std::int64_t>(i)][static_cast<std::int64_t>(q)].item<double>();
        // At d^2 = 16 exactly, rounding decides which side a pair is on; A is 3e-4 there.
        worst = std::max(worst, std::abs(p[q] - trained));
        largest = std::max(largest, trained);
        sum += trained;
      }
      if (variant == renderer::LabelVariant::kNormalised ||
          variant == renderer::LabelVariant::kLogSoftmax) {
        EXPECT_NEAR(p[20], 1.0 - sum, 5e-3);  // The none-score takes the rest.
      }
    }
    EXPECT_LT(worst, 5e-3);
    EXPECT_GT(largest, variant == renderer::LabelVariant::kLiteral ? 0.08 : 0.5);
  }
}

TEST(Attention, FusedIsUnfused) {
  const at::Tensor logit = random_tensor({50, 7}, 1, -4.0, 4.0);
  const at::Tensor distance2 = random_tensor({50, 7}, 2, 0.0, 20.0);
  const at::Tensor weight = random_tensor({50, 7}, 3);
  for (const renderer::LabelVariant variant : kVariants) {
    SCOPED_TRACE(static_cast<int>(variant));
    const LabelSettings settings{variant, 0.05, 0.3};
    std::array<std::array<at::Tensor, 3>, 2> results;
    for (const bool fused : {false, true}) {
      const at::Tensor x = logit.clone().requires_grad_(true);
      const at::Tensor d = distance2.clone().requires_grad_(true);
      const at::Tensor labels =
          fused ? query_labels(x, d, settings) : query_labels_unfused(x, d, settings);
      (labels * weight).sum().backward();
      results[fused ? 1 : 0] = {labels, x.grad(), d.grad()};
    }
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_TRUE(torch::allclose(results[0][i], results[1][i], 1e-9, 1e-12)) << i;
    }
  }
}

TEST(Attention, DistanceAtOneSigmaIsOne) {
  const at::Tensor query = testing::tensor_of({1, 2, 3}, {1, 3});
  const at::Tensor log_sigma =
      testing::tensor_of({std::log(0.5), std::log(0.2), std::log(2.0)}, {1, 3});
  // A quarter turn about z: the query's x axis is the world's y axis.
  const at::Tensor rotation = testing::tensor_of({1, 0, 0, 1}, {1, 4});
  const at::Tensor points =
      testing::tensor_of({1, 2.5, 3, 1.2, 2, 3, 1, 2, 5, 1, 2, 3, 1, 3, 3}, {5, 3});
  const at::Tensor d2 = squared_distances(points, query, log_sigma, rotation);
  const std::array expected{1.0, 1.0, 1.0, 0.0, 4.0};
  for (std::int64_t i = 0; i < 5; ++i) {
    EXPECT_NEAR(d2[i][0].item<double>(), expected[static_cast<std::size_t>(i)], 1e-12);
  }
}

TEST(Attention, DerivativesAreThoseOfFiniteDifferences) {
  const at::Tensor points = random_tensor({9, 3}, 11);
  const at::Tensor weight = random_tensor({9, 4}, 12);
  const Inputs at{random_tensor({4, 3}, 13), random_tensor({4, 3}, 14, -0.7, 0.3),
                  random_tensor({4, 4}, 15, 0.2, 1.0), random_tensor({9, 4}, 16, -2.0, 2.0)};
  for (const renderer::LabelVariant variant : kVariants) {
    SCOPED_TRACE(static_cast<int>(variant));
    expect_derivatives(
        [&](const Inputs& x) {
          const at::Tensor d2 = squared_distances(points, x[0], x[1], x[2]);
          return (query_labels(x[3], d2, {variant, 0.05, 0.3}) * weight).sum();
        },
        at);
  }
}

}  // namespace
}  // namespace segsim::reconstruction
