#include "reconstruction/labels/internal/label_losses.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/reconstruction/training/finite_differences.h"

namespace segsim::reconstruction {
namespace {

using internal::bce_losses;
using internal::class_cross_entropy;
using internal::dice_losses;
using internal::mask_costs;
using internal::negative_log_likelihood;
using internal::repulsion_loss;
using internal::symmetric_kl;
using testing::expect_derivatives;
using testing::random_tensor;
using testing::tensor_of;
using Inputs = std::vector<at::Tensor>;

const at::Tensor kTwoMasks = tensor_of({1, 0, 1, 1, 0, 0, 0, 1}, {4, 2});
const at::Tensor kEven = tensor_of({1, 1, 1, 1}, {4});

TEST(LabelLosses, NegativeLogLikelihoodByHand) {
  // Half of the second pixel counts: (-log 0.5 - 0.5 log 0.25) / 2 = 1.5 log(2) ... / 2.
  const at::Tensor loss =
      negative_log_likelihood(tensor_of({0.5, 0.25}, {2}), tensor_of({1.0, 0.5}, {2}));
  EXPECT_NEAR(loss.item<double>(), std::log(2.0), 1e-5);
  // A probability of 0 costs -log(1e-6), not infinity.
  EXPECT_NEAR(
      negative_log_likelihood(tensor_of({0.0}, {1}), tensor_of({1.0}, {1})).item<double>(),
      6.0 * std::log(10.0), 1e-9);
}

TEST(LabelLosses, DiceByHand) {
  const at::Tensor mask = tensor_of({1, 0.2, 1, 0.4, 0, 0.6, 0, 0.8}, {4, 2});
  const at::Tensor dice = dice_losses(mask, kTwoMasks, kEven);
  EXPECT_NEAR(dice[0].item<double>(), 0.0, 1e-6);
  // 2 (0.4 + 0.8) / (2.0 + 2) = 0.6.
  EXPECT_NEAR(dice[1].item<double>(), 0.4, 1e-6);
  EXPECT_NEAR(dice_losses(1.0 - kTwoMasks, kTwoMasks, kEven)[0].item<double>(), 1.0, 1e-6);
  // Two pixels drawn twice as often count half: 2 (0.4 / 2 + 0.8) / (0.2 / 2 + 0.4 / 2 + 0.6 +
  // 0.8 + 1 / 2 + 1) = 0.625.
  const at::Tensor often = dice_losses(mask, kTwoMasks, tensor_of({0.5, 0.5, 1, 1}, {4}));
  EXPECT_NEAR(often[1].item<double>(), 0.375, 1e-6);
}

TEST(LabelLosses, BceByHand) {
  const at::Tensor half = tensor_of({0.5, 0.5, 0.5, 0.5}, {4, 1});
  const at::Tensor target = tensor_of({1, 0, 1, 0}, {4, 1});
  const at::Tensor sure = tensor_of({1, 1, 1, 1}, {4}), unsure = 0.25 * sure;
  EXPECT_NEAR(bce_losses(half, target, sure).item<double>(), std::log(2.0), 1e-9);
  EXPECT_NEAR(bce_losses(half, target, unsure).item<double>(), 0.25 * std::log(2.0), 1e-9);
  EXPECT_NEAR(bce_losses(target, target, sure).item<double>(), 1e-6, 1e-9);
}

TEST(LabelLosses, BestDiceOfTheLiteralSoftmaxIsThePapersProblem) {
  // N = 50 queries: 0.0526 inside, 0.0193 outside of a mask of 10 % (panoptic brief, C.4).
  const double inside = std::exp(1.0) / (std::exp(1.0) + 49.0);
  const double outside = 1.0 / (std::exp(1.0) + 49.0);
  at::Tensor mask = torch::full({1000, 1}, outside, torch::kFloat64);
  at::Tensor target = torch::zeros({1000, 1}, torch::kFloat64);
  mask.slice(0, 0, 100).fill_(inside);
  target.slice(0, 0, 100).fill_(1.0);
  EXPECT_NEAR(dice_losses(mask, target, at::ones({1000}, torch::kFloat64)).item<double>(),
              0.914, 1e-3);
  EXPECT_NEAR(-std::log(inside), 2.95, 5e-3);
}

TEST(LabelLosses, CostsOfAllPairsAreTheLossesOfEachPair) {
  const at::Tensor mask = random_tensor({40, 6}, 1, 0.0, 1.0);
  const at::Tensor target = random_tensor({40, 3}, 2).gt(0.0).to(torch::kFloat64);
  const at::Tensor importance = random_tensor({40}, 4, 0.5, 2.0);
  const at::Tensor weight = importance * random_tensor({40}, 3, 0.0, 1.0);
  const auto costs = mask_costs(mask, target, importance, weight);
  for (std::int64_t q = 0; q < 6; ++q) {
    for (std::int64_t m = 0; m < 3; ++m) {
      const at::Tensor one = mask.slice(1, q, q + 1), other = target.slice(1, m, m + 1);
      EXPECT_NEAR(costs.dice[q][m].item<double>(),
                  dice_losses(one, other, importance).item<double>(), 1e-12);
      EXPECT_NEAR(costs.bce[q][m].item<double>(),
                  bce_losses(one, other, weight).item<double>(), 1e-12);
    }
  }
}

TEST(LabelLosses, ClassCrossEntropyByHand) {
  const at::Tensor logits = tensor_of({0, 0, std::log(3.0), 0}, {2, 2});
  const at::Tensor target =
      internal::device_tensor<std::int64_t>({0, 1}, torch::kInt64, torch::kCPU);
  // log 2 with weight 1, -log(1/4) with weight 0.1.
  const double expected = (std::log(2.0) + 0.1 * std::log(4.0)) / 1.1;
  EXPECT_NEAR(class_cross_entropy(logits, target, tensor_of({1.0, 0.1}, {2})).item<double>(),
              expected, 1e-12);
  EXPECT_EQ(class_cross_entropy(logits, target, tensor_of({0.0, 0.0}, {2})).item<double>(),
            0.0);
}

TEST(LabelLosses, RepulsionByHand) {
  const at::Tensor embedding = tensor_of({0, 0, 3, 4, 0, 30}, {3, 2});
  // Distances 5, 30 and sqrt(9 + 676) > 10: two of six ordered pairs are 5 too close.
  EXPECT_NEAR(repulsion_loss(embedding, 10.0).item<double>(), 10.0 / 6.0, 1e-9);
  EXPECT_EQ(repulsion_loss(embedding.slice(0, 0, 1), 10.0).item<double>(), 0.0);
  const at::Tensor equal = torch::ones({3, 2}, torch::kFloat64).requires_grad_(true);
  repulsion_loss(equal, 10.0).backward();
  EXPECT_TRUE(torch::isfinite(equal.grad()).all().item<bool>());
}

TEST(LabelLosses, SymmetricKlByHand) {
  const at::Tensor a = tensor_of({0.5, 0.5}, {1, 2}), b = tensor_of({0.25, 0.75}, {1, 2});
  const double expected = 0.5 * (0.25 * std::log(2.0) - 0.25 * std::log(0.5 / 0.75));
  EXPECT_NEAR(symmetric_kl(a, b).item<double>(), expected, 1e-5);
  EXPECT_EQ(symmetric_kl(a, a).item<double>(), 0.0);
}

TEST(LabelLosses, DerivativesAreThoseOfFiniteDifferences) {
  const at::Tensor mask = random_tensor({12, 3}, 4, 0.05, 0.95);
  const at::Tensor target = random_tensor({12, 3}, 5).gt(0.0).to(torch::kFloat64);
  const at::Tensor confidence = random_tensor({12}, 6, 0.2, 1.0);
  expect_derivatives(
      [&](const Inputs& x) { return negative_log_likelihood(x[0], confidence); },
      {mask.select(1, 0).contiguous()});
  expect_derivatives(
      [&](const Inputs& x) { return dice_losses(x[0], target, confidence).sum(); }, {mask});
  expect_derivatives(
      [&](const Inputs& x) { return bce_losses(x[0], target, confidence).sum(); }, {mask});
  const at::Tensor classes =
      internal::device_tensor<std::int64_t>({0, 3, 1, 2, 2}, torch::kInt64, torch::kCPU);
  expect_derivatives(
      [&](const Inputs& x) {
        return class_cross_entropy(x[0], classes, confidence.slice(0, 0, 5));
      },
      {random_tensor({5, 4}, 7, -2.0, 2.0)});
  expect_derivatives([](const Inputs& x) { return repulsion_loss(x[0], 2.0); },
                     {random_tensor({5, 3}, 8)});
  expect_derivatives(
      [](const Inputs& x) { return symmetric_kl(x[0], x[1]); },
      {random_tensor({6, 3}, 9, 0.1, 0.9), random_tensor({6, 3}, 10, 0.1, 0.9)});
}

}  // namespace
}  // namespace segsim::reconstruction
