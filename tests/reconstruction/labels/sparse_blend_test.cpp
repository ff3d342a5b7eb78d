#include "reconstruction/labels/internal/sparse_blend.h"

#include <gtest/gtest.h>

#include "core/check.h"
#include "core/random.h"
#include "tests/reconstruction/training/finite_differences.h"

namespace segsim::reconstruction {
namespace {

using internal::blend;
using internal::blend_channel;
using internal::BlendMatrix;
using internal::BlendMatrixMaker;
using testing::random_tensor;

/// Rows of random length, some of them empty, over a cloud of 500 surfels.
struct Rows {
  Rows(int pixels, std::uint64_t seed) {
    core::RandomStream random(seed, "rows");
    for (int p = 0; p < pixels; ++p) {
      const std::uint32_t length = p % 5 == 3 ? 0 : random.index(6);
      for (std::uint32_t k = 0; k < length; ++k) {
        surfel.push_back(static_cast<std::int32_t>(100 + random.index(60)));
        weight.push_back(static_cast<float>(random.uniform(0.01, 0.3)));
      }
      start.push_back(static_cast<std::int32_t>(surfel.size()));
    }
  }
  [[nodiscard]] PixelWeights view() const {
    return {static_cast<std::int64_t>(start.size()) - 1,
            static_cast<std::int64_t>(surfel.size()), start.data(), surfel.data(),
            weight.data()};
  }
  std::vector<std::int32_t> start{0}, surfel;
  std::vector<float> weight;
};

/// W as a dense matrix over the batch's surfels, weights divided by their sum.
at::Tensor dense(const BlendMatrix& m, const std::vector<const Rows*>& parts) {
  at::Tensor w = torch::zeros({m.pixels, m.surfels()}, torch::kFloat64);
  std::int64_t row = 0;
  for (const Rows* part : parts) {
    for (std::size_t p = 0; p + 1 < part->start.size(); ++p, ++row) {
      double sum = 0.0;
      for (int e = part->start[p]; e < part->start[p + 1]; ++e) {
        sum += static_cast<double>(part->weight[static_cast<std::size_t>(e)]);
      }
      for (int e = part->start[p]; e < part->start[p + 1]; ++e) {
        for (std::int64_t s = 0; s < m.surfels(); ++s) {
          if (m.surfel[s].item<std::int64_t>() != part->surfel[static_cast<std::size_t>(e)]) {
            continue;
          }
          w[row][s] += static_cast<double>(part->weight[static_cast<std::size_t>(e)]) / sum;
        }
      }
    }
  }
  return w;
}

/// Loss of both kinds of blending as the weights decide about it.
double loss_of_weights(const Rows& rows, const at::Tensor& cloud_labels, const at::Tensor& by,
                       GeometryGradient* gradient) {
  BlendMatrixMaker maker(500, torch::kCPU);
  const Rows more(5, 6);
  const PixelWeights below = more.view();
  const BlendMatrix m = maker.make(rows.view(), &below, gradient != nullptr);
  const at::Tensor labels = cloud_labels.index_select(0, m.surfel);
  const at::Tensor channel = torch::arange(0, m.pixels) % 8 - 1;  // Some have none.
  const at::Tensor loss =
      (blend(m, labels) * by).sum() +
      (blend_channel(m, labels, channel, labels.select(1, 2)) * by.select(1, 0)).sum();
  if (gradient != nullptr) {
    const at::Tensor nowhere = torch::zeros({m.surfels(), 3});
    loss.backward();
    PanopticBatch batch;
    batch.weights = rows.view();
    *gradient = geometry_gradient(m, batch, nowhere);
  }
  return loss.item<double>();
}

TEST(SparseBlend, HasDerivativesByWeightsBeforeTheyAreNormalised) {
  Rows rows(40, 5);
  const at::Tensor labels = random_tensor({500, 7}, 3), by = random_tensor({45, 7}, 4);
  GeometryGradient gradient;
  loss_of_weights(rows, labels, by, &gradient);
  ASSERT_EQ(gradient.by_weight.size(), rows.weight.size());
  EXPECT_TRUE(gradient.surfel.empty());
  double largest = 0.0;
  for (std::size_t e = 0; e < rows.weight.size(); ++e) {
    const float kept = rows.weight[e], step = 2e-3F;
    rows.weight[e] = kept + step;
    const double above = loss_of_weights(rows, labels, by, nullptr);
    rows.weight[e] = kept - step;
    const double below = loss_of_weights(rows, labels, by, nullptr);
    rows.weight[e] = kept;
    const double expected = (above - below) / (2.0 * static_cast<double>(step));
    largest = std::max(largest, std::abs(expected));
    EXPECT_NEAR(gradient.by_weight[e], expected, 0.05 * std::abs(expected) + 0.02) << e;
  }
  EXPECT_GT(largest, 1.0);
}

TEST(SparseBlend, IsTheDenseProduct) {
  const Rows rows(60, 1), more(11, 2);
  BlendMatrixMaker maker(500, torch::kCPU);
  for (const bool both : {false, true}) {
    const PixelWeights below = more.view();
    const BlendMatrix m = maker.make(rows.view(), both ? &below : nullptr);
    EXPECT_EQ(m.pixels, both ? 71 : 60);
    const at::Tensor w = dense(
        m, both ? std::vector<const Rows*>{&rows, &more} : std::vector<const Rows*>{&rows});
    const at::Tensor labels = random_tensor({m.surfels(), 7}, 3).requires_grad_(true);
    const at::Tensor weight = random_tensor({m.pixels, 7}, 4);
    const at::Tensor out = blend(m, labels);
    EXPECT_TRUE(torch::allclose(out, w.matmul(labels), 1e-6, 1e-6));
    (out * weight).sum().backward();
    EXPECT_TRUE(torch::allclose(labels.grad(), w.t().matmul(weight), 1e-6, 1e-6));
  }
}

TEST(SparseBlend, OneChannelIsThatChannelOfAll) {
  const Rows rows(60, 1);
  BlendMatrixMaker maker(500, torch::kCPU);
  const BlendMatrix m = maker.make(rows.view());
  std::vector<std::int64_t> channel;
  for (int p = 0; p < 60; ++p) channel.push_back(p % 9 - 1);  // -1 ... 7 of 8.
  const at::Tensor index = internal::device_tensor(channel, torch::kInt64, torch::kCPU);
  const at::Tensor weight = random_tensor({60}, 5);
  const at::Tensor labels = random_tensor({m.surfels(), 8}, 6);
  const at::Tensor one = labels.clone().requires_grad_(true);
  const at::Tensor all = labels.clone().requires_grad_(true);
  const at::Tensor picked =
      blend(m, all).gather(1, index.clamp_min(0).unsqueeze(1)).squeeze(1) *
      index.ge(0).to(torch::kFloat64);
  const at::Tensor direct = blend_channel(m, one, index);
  EXPECT_TRUE(torch::allclose(direct, picked, 1e-9, 1e-12));
  (direct * weight).sum().backward();
  (picked * weight).sum().backward();
  EXPECT_TRUE(torch::allclose(one.grad(), all.grad(), 1e-9, 1e-12));
}

TEST(SparseBlend, DerivativesOfAScaledChannelAreThoseOfFiniteDifferences) {
  const Rows rows(15, 1);
  BlendMatrixMaker maker(500, torch::kCPU);
  const BlendMatrix m = maker.make(rows.view());
  std::vector<std::int64_t> channel;
  for (int p = 0; p < 15; ++p) channel.push_back(p % 4 - 1);
  const at::Tensor index = internal::device_tensor(channel, torch::kInt64, torch::kCPU);
  const at::Tensor weight = random_tensor({15}, 5);
  testing::expect_derivatives(
      [&](const std::vector<at::Tensor>& x) {
        return (blend_channel(m, x[0], index, x[1]) * weight).sum();
      },
      {random_tensor({m.surfels(), 3}, 6), random_tensor({m.surfels()}, 7)});
}

TEST(SparseBlend, AlphaIsTheSumBeforeNormalisation) {
  const Rows rows(40, 7);
  BlendMatrixMaker maker(500, torch::kCPU);
  const BlendMatrix m = maker.make(rows.view());
  const at::Tensor ones = blend(m, torch::ones({m.surfels(), 1}));
  for (std::size_t p = 0; p < 40; ++p) {
    float sum = 0.0F;
    for (int e = rows.start[p]; e < rows.start[p + 1]; ++e) {
      sum += rows.weight[static_cast<std::size_t>(e)];
    }
    const auto row = static_cast<std::int64_t>(p);
    EXPECT_FLOAT_EQ(m.alpha[row].item<float>(), sum);
    EXPECT_NEAR(ones[row][0].item<double>(), sum > 0.0F ? 1.0 : 0.0, 1e-6);
  }
}

TEST(SparseBlend, SurfelsOutsideTheCloudAreRefused) {
  const Rows rows(20, 1);
  BlendMatrixMaker maker(120, torch::kCPU);
  EXPECT_THROW(static_cast<void>(maker.make(rows.view())), core::ContractViolation);
}

TEST(SparseBlend, ABatchWithoutAnythingIsEmpty) {
  BlendMatrixMaker maker(10, torch::kCPU);
  const std::int32_t start[]{0, 0};
  const BlendMatrix m = maker.make({1, 0, start, nullptr, nullptr});
  EXPECT_EQ(m.surfels(), 0);
  EXPECT_EQ(blend(m, torch::zeros({0, 3})).sum().item<float>(), 0.0F);
}

}  // namespace
}  // namespace segsim::reconstruction
