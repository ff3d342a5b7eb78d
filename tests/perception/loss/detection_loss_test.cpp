#include "perception/internal/loss/detection_loss.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/error.h"
#include "core/random.h"
#include "perception/internal/loss/assigner.h"
#include "perception/internal/loss/ciou.h"

namespace segsim::perception {
namespace {

constexpr int kClasses = 3, kInput_px = 64, kAnchors = 64 + 16 + 4;

/// Logits as plain numbers, so that the twin needs no torch.
struct Logits {
  std::vector<double> box, classes;  ///< One image.
};

Logits random_logits(std::uint64_t seed) {
  core::RandomStream random(seed, "logits");
  Logits logits;
  for (int i = 0; i < kAnchors * 4 * kRegBins; ++i) logits.box.push_back(random.normal());
  for (int i = 0; i < kAnchors * kClasses; ++i)
    logits.classes.push_back(random.normal() - 2.0);
  return logits;
}

torch::Tensor tensor_of(const std::vector<double>& values, std::vector<int64_t> shape) {
  return torch::tensor(values, torch::kFloat32).view(shape);
}

std::vector<LabeledBox> some_truth() {
  const auto label = [](int class_index, core::BoxPx box, bool ignore) {
    LabeledBox result;
    result.class_index = class_index;
    result.box = box;
    result.ignore = ignore;
    return result;
  };
  return {label(0, {5, 6, 40, 33}, false), label(2, {20, 10, 60, 60}, false),
          label(1, {0, 40, 30, 64}, true)};
}

double softmax_at(const double* logits, int wanted) {
  double sum = 0.0;
  for (int i = 0; i < kRegBins; ++i) sum += std::exp(logits[i]);
  return std::exp(logits[wanted]) / sum;
}

/// The loss in scalars, straight from its definition (one image).
double slow_total(const Logits& logits, const std::vector<LabeledBox>& truth) {
  std::vector<float> centres, strides, scores, boxes;
  for (const int stride : kStrides) {
    for (int y = 0; y < kInput_px / stride; ++y) {
      for (int x = 0; x < kInput_px / stride; ++x) {
        centres.push_back(static_cast<float>(x * stride) + static_cast<float>(stride) / 2);
        centres.push_back(static_cast<float>(y * stride) + static_cast<float>(stride) / 2);
        strides.push_back(static_cast<float>(stride));
      }
    }
  }
  for (std::size_t a = 0; a < kAnchors; ++a) {
    for (int side = 0; side < 4; ++side) {
      double mean = 0.0;
      const double* bins = &logits.box[(a * 4 + side) * kRegBins];
      for (int i = 0; i < kRegBins; ++i) mean += i * softmax_at(bins, i);
      const double sign = side < 2 ? -1.0 : 1.0;
      boxes.push_back(
          static_cast<float>(centres[2 * a + side % 2] + sign * mean * strides[a]));
    }
    for (std::size_t c = 0; c < kClasses; ++c) {
      scores.push_back(
          static_cast<float>(1.0 / (1.0 + std::exp(-logits.classes[a * kClasses + c]))));
    }
  }
  const Assignment assigned = assign_anchors({kClasses, centres, scores, boxes, truth});
  double sum = 0.0, box_loss = 0.0, bin_loss = 0.0, class_loss = 0.0;
  for (std::size_t a = 0; a < kAnchors; ++a) {
    const int owner = assigned.box_of_anchor[a];
    const double weight = assigned.target_score[a];
    sum += weight;
    for (int c = 0; c < kClasses; ++c) {
      const double p = 1.0 / (1.0 + std::exp(-logits.classes[a * kClasses + c]));
      const double y = owner >= 0 && truth[owner].class_index == c ? weight : 0.0;
      class_loss -= assigned.class_weight[a * kClasses + c] *
                    (y * std::log(p) + (1.0 - y) * std::log(1.0 - p));
    }
    if (owner < 0) continue;
    const core::BoxPx& g = truth[owner].box;
    const core::BoxPx p{boxes[4 * a], boxes[4 * a + 1], boxes[4 * a + 2], boxes[4 * a + 3]};
    box_loss += weight * (1.0 - ciou(p, g));
    const double sides[] = {centres[2 * a] - g.x0, centres[2 * a + 1] - g.y0,
                            g.x1 - centres[2 * a], g.y1 - centres[2 * a + 1]};
    for (int side = 0; side < 4; ++side) {
      const double target = std::min(std::max(sides[side] / strides[a], 0.0), 14.99);
      const int lower = static_cast<int>(target);
      const double* bins = &logits.box[(a * 4 + side) * kRegBins];
      bin_loss -= weight / 4.0 *
                  ((lower + 1 - target) * std::log(softmax_at(bins, lower)) +
                   (target - lower) * std::log(softmax_at(bins, lower + 1)));
    }
  }
  const double divisor = std::max(sum, 1.0);
  return (7.5 * box_loss + 0.5 * class_loss + 1.5 * bin_loss) / divisor;
}

double fast_total(const Logits& logits, const std::vector<LabeledBox>& truth) {
  const RawOutput output{tensor_of(logits.box, {1, kAnchors, 4 * kRegBins}),
                         tensor_of(logits.classes, {1, kAnchors, kClasses})};
  const Anchors anchors = make_anchors(kInput_px, torch::kFloat32);
  return detection_loss(output, anchors, {truth}).total(1).item<double>();
}

TEST(DetectionLoss, RowsOfCiouAgreeWithScalars) {
  core::RandomStream random(1, "ciou");
  std::vector<double> a, b;
  for (int i = 0; i < 200; ++i) {
    for (auto* box : {&a, &b}) {
      const double x = random.uniform(0, 30), y = random.uniform(0, 30);
      box->insert(box->end(), {x, y, x + random.uniform(1, 30), y + random.uniform(1, 30)});
    }
  }
  const auto rows = ciou_rows(tensor_of(a, {-1, 4}), tensor_of(b, {-1, 4}));
  const auto box = [](const std::vector<double>& v, int i) {
    return core::BoxPx{static_cast<float>(v[4 * i]), static_cast<float>(v[4 * i + 1]),
                       static_cast<float>(v[4 * i + 2]), static_cast<float>(v[4 * i + 3])};
  };
  for (int i = 0; i < 200; ++i) {
    EXPECT_NEAR(rows[i].item<double>(), ciou(box(a, i), box(b, i)), 2e-5);
  }
}

TEST(DetectionLoss, BinLossOfUniformLogitsIsLogOfBins) {
  const auto logits = torch::zeros({2, 4 * kRegBins});
  const auto distances = torch::tensor({0.0F, 3.25F, 14.99F, 40.0F, -2.0F, 1.0F, 7.5F, 2.0F});
  const auto loss = bin_loss_rows(logits, distances.view({2, 4}));
  for (int i = 0; i < 2; ++i) EXPECT_NEAR(loss[i].item<double>(), std::log(16.0), 1e-5);
}

TEST(DetectionLoss, AgreesWithScalarTwin) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    const Logits logits = random_logits(seed);
    const double slow = slow_total(logits, some_truth());
    EXPECT_NEAR(fast_total(logits, some_truth()), slow, 1e-4 * slow) << seed;
  }
}

TEST(DetectionLoss, EmptyImageHasOnlyClassLoss) {
  const Logits logits = random_logits(3);
  const double slow = slow_total(logits, {});
  EXPECT_NEAR(fast_total(logits, {}), slow, 1e-4 * slow);
}

TEST(DetectionLoss, IgnoredObjectCostsNothing) {
  Logits logits = random_logits(4);
  std::vector<LabeledBox> truth(1);
  truth[0].box = {0, 0, 64, 64};
  truth[0].ignore = true;  // Class 0, the whole image.
  const double before = fast_total(logits, truth);
  for (std::size_t a = 0; a < kAnchors; ++a) logits.classes[a * kClasses] += 3.0;
  EXPECT_NEAR(fast_total(logits, truth), before, 1e-5);
  truth[0].ignore = false;
  EXPECT_GT(std::fabs(fast_total(logits, truth) - before), 0.1);
}

TEST(DetectionLoss, GradientAgreesWithFiniteDifferences) {
  const Logits logits = random_logits(5);
  // CIoU's alpha is held fixed in the gradient, so a difference quotient only agrees in the
  // parts without it: classes and bins.
  const Anchors anchors = make_anchors(kInput_px, torch::kFloat32);
  auto box = tensor_of(logits.box, {1, kAnchors, 4 * kRegBins}).to(torch::kFloat64);
  const auto distances = torch::full({kAnchors, 4}, 2.3, torch::kFloat64);
  box.set_requires_grad(true);
  bin_loss_rows(box.view({-1, 4 * kRegBins}), distances).sum().backward();
  const auto value = [&](int64_t index, double shift) {
    auto moved = box.detach().clone();
    moved.view({-1})[index] += shift;
    return bin_loss_rows(moved.view({-1, 4 * kRegBins}), distances).sum().item<double>();
  };
  for (const int64_t index : {0, 2, 3, 17, 901}) {
    const double slope = (value(index, 1e-5) - value(index, -1e-5)) / 2e-5;
    EXPECT_NEAR(box.grad().view({-1})[index].item<double>(), slope, 1e-7);
  }
}

TEST(Decode, OneHotBinsGiveExactDistances) {
  const Anchors anchors = make_anchors(kInput_px, torch::kFloat32);
  auto logits = torch::full({1, kAnchors, 4, kRegBins}, -50.0F);
  const int64_t bins[] = {1, 2, 3, 4};
  for (int64_t side = 0; side < 4; ++side)
    logits.select(2, side).select(2, bins[side]).fill_(50.0F);
  const auto boxes = decode_boxes(logits.view({1, kAnchors, 4 * kRegBins}), anchors)[0];
  // Anchor 9 is cell (1, 1) of stride 8, centre (12, 12); anchor 64 is cell (0, 0) of
  // stride 16.
  const float expected9[] = {4, -4, 36, 44}, expected64[] = {-8, -24, 56, 72};
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(boxes[9][i].item<float>(), expected9[i], 1e-4);
    EXPECT_NEAR(boxes[64][i].item<float>(), expected64[i], 1e-4);
  }
}

TEST(Network, SizesAreThoseOfTheRecipe) {
  const auto parameters = [](double width) {
    std::int64_t count = 0;
    for (const auto& p : TinyDetector(width, 6, 256)->parameters()) count += p.numel();
    return count;
  };
  EXPECT_NEAR(static_cast<double>(parameters(0.5)), 0.45e6, 0.05e6);
  EXPECT_NEAR(static_cast<double>(parameters(1.0)), 1.78e6, 0.2e6);
}

TEST(Network, FoldingBatchNormKeepsOutputs) {
  TinyDetector network(0.25, kClasses, kInput_px);
  network->initialize(7);
  core::RandomStream random(1, "pixels");
  auto input = torch::empty({2, 3, kInput_px, kInput_px});
  for (int64_t i = 0; i < input.numel(); ++i) {
    input.data_ptr<float>()[i] = static_cast<float>(random.uniform());
  }
  const torch::NoGradGuard no_grad;
  for (int i = 0; i < 20; ++i) (void)network->forward(input);  // Moves the running statistics.
  network->eval();
  const RawOutput plain = network->forward(input);
  network->prepare_for_inference();
  const RawOutput folded = network->forward(input);
  EXPECT_EQ(plain.box.size(1), kAnchors);
  EXPECT_GT(plain.box.std().item<double>(), 1e-3);
  EXPECT_LT((plain.box - folded.box).abs().max().item<double>(), 1e-4);
  EXPECT_LT((plain.classes - folded.classes).abs().max().item<double>(), 1e-4);
}

TEST(Network, TensorsThatDoNotFitAreNamed) {
  TinyDetector network(0.25, kClasses, kInput_px);
  auto tensors = export_tensors(*network);
  tensors[0].shape.push_back(1);
  try {
    import_tensors(*network, tensors, "w.bin");
    FAIL();
  } catch (const core::InputError& error) {
    EXPECT_NE(std::string(error.what()).find("w.bin"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find(tensors[0].name), std::string::npos);
  }
}

}  // namespace
}  // namespace segsim::perception
