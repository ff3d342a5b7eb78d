#include <algorithm>
#include <cmath>

#include "checks.h"
#include "perception/internal/loss/detection_loss.h"
#include "perception/training/internal/trainable_network.h"

namespace segsim::perception::checks {

namespace {

/// A network starts with scores of 1e-5, which would be equal whatever the class branch does.
DetectorWeights with_scores_in_the_middle(DetectorWeights weights) {
  for (NamedTensor& tensor : weights.tensors) {
    if (!tensor.name.ends_with(".bias") || tensor.values[0] > -3.0F) continue;
    for (float& value : tensor.values) value = 0.0F;
  }
  return weights;
}

}  // namespace

// What inference does on the device with layers folded and laid out for it, against the plain
// layers on the CPU. The limits are the documented ones of the port: 1e-3 px, scores 1e-5.
void check_forward(const std::string& name, const DetectorWeights& start, int batch,
                   const torch::Device& device) {
  const torch::InferenceMode inference;
  const DetectorWeights weights = with_scores_in_the_middle(start);
  auto plain = make_trainable_network(weights.architecture, weights.width,
                                      static_cast<int>(weights.class_names.size()),
                                      weights.input_px, 1);
  import_tensors(*plain.module, weights.tensors, name);
  plain.module->eval();
  const auto on_device = make_inference_network(weights, name, device);
  const auto input = noise(batch, weights.input_px);
  const RawOutput wanted = to_cpu(plain.forward(input)),
                  found = to_cpu(on_device(input.to(device)));
  const Anchors anchors = make_anchors(weights.input_px, torch::TensorOptions(torch::kCPU));
  expect_below(
      name + " forward, batch " + std::to_string(batch) + ", boxes [px]",
      largest_difference(decode_boxes(found.box, anchors), decode_boxes(wanted.box, anchors)),
      1e-3);
  const auto scores = wanted.classes.sigmoid();
  expect_below(name + " forward, scores", largest_difference(found.classes.sigmoid(), scores),
               1e-5);
  expect_below(name + " forward, 1 / range of the scores that were compared",
               1.0 / (scores.max() - scores.min()).item<double>(), 100.0);
}

// CUDA makes the targets in another way than the CPU, whose loss is tested by itself. The sums
// differ in their order: 2e-7 of the loss measured, 4e-8 of its derivatives.
void check_loss(const std::string& name, const DetectorWeights& weights,
                const torch::Device& device) {
  const int classes = static_cast<int>(weights.class_names.size());
  RawOutput raw;
  {
    const torch::NoGradGuard no_grad;
    raw = to_cpu(make_inference_network(weights, name)(noise(2, weights.input_px)));
  }
  const AssignerRule rule =
      weights.architecture == DetectorWeights::kArchitecture ? AssignerRule{} : kYoloRule;
  const auto truth = some_truth(2, classes, weights.input_px);
  struct Result {
    std::vector<double> parts;
    torch::Tensor box_gradient, class_gradient;
  };
  const auto run = [&](const torch::Device& where) {
    RawOutput own{raw.box.detach().to(where).clone().requires_grad_(true),
                  raw.classes.detach().to(where).clone().requires_grad_(true)};
    const LossParts parts = detection_loss(
        own, make_anchors(weights.input_px, torch::TensorOptions(where)), truth, rule);
    (parts.box + parts.classes + parts.bins).backward();
    return Result{
        {parts.box.item<double>(), parts.classes.item<double>(), parts.bins.item<double>()},
        own.box.grad(),
        own.classes.grad()};
  };
  const Result cpu = run(torch::kCPU), other = run(device);
  double worst = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    worst = std::max(worst, std::abs(cpu.parts[i] - other.parts[i]) / cpu.parts[i]);
  }
  expect_below(name + " loss, relative", worst, 1e-5);
  expect_below(name + " loss, gradient of the boxes",
               largest_difference(cpu.box_gradient, other.box_gradient), 1e-6);
  expect_below(name + " loss, gradient of the classes",
               largest_difference(cpu.class_gradient, other.class_gradient), 1e-6);
}

// By tensor operations on the device and by loops on the CPU; the limits are those of the
// forward pass (scores count a hundredfold). 6e-5 was measured.
void check_decoding(const DetectorWeights& weights, const torch::Device& device) {
  const torch::InferenceMode inference;
  const RawOutput raw =
      to_cpu(make_inference_network(weights, "decoding")(noise(3, weights.input_px)));
  // Between two scores, so that rounding does not decide.
  const float threshold = 0.5F * (score_of_rank(raw, 500) + score_of_rank(raw, 501)) + 1e-9F;
  const auto host = candidates_on_host(
      raw, make_anchors(weights.input_px, torch::TensorOptions(torch::kCPU)), threshold);
  const auto other = candidates_on_device(
      {raw.box.to(device), raw.classes.to(device)},
      make_anchors(weights.input_px, torch::TensorOptions(device)), threshold);
  double worst = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < host.size(); ++i) {
    worst = std::max(worst, worst_difference(host[i], other[i]));
    count += host[i].size();
  }
  expect_below("decoding of " + std::to_string(count) + " candidates, boxes [px]", worst,
               1e-3);
}

}  // namespace segsim::perception::checks
