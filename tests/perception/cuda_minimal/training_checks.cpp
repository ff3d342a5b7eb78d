#include <chrono>
#include <cmath>
#include <cstdio>

#include "checks.h"
#include "perception/training/internal/trainable_network.h"
#include "perception/training/internal/training_step.h"

namespace segsim::perception::checks {
namespace {

TrainOptions step_options(ComputeDevice device, bool mixed, int input_px, int batch) {
  TrainOptions options;
  options.input_px = input_px;
  options.batch = batch;
  options.steps = 200;
  options.warmup_steps = 5;
  options.device = device;
  options.mixed_precision = mixed;
  return options;
}

/// Dropout draws other numbers on CUDA than on the CPU. It is the only part of the networks
/// that a mode of the hyperedge generators decides.
void stop_dropout(torch::nn::Module& network) {
  for (const auto& item : network.named_modules("", false)) {
    if (item.key().ends_with("edge_generator")) item.value()->eval();
  }
}

/// Trains on one batch, without dropout. @returns the losses per image.
std::vector<double> losses_of(const DetectorWeights& weights, const TrainOptions& options,
                              int steps, double* ms_per_step = nullptr) {
  const int classes = static_cast<int>(weights.class_names.size());
  const auto network = [&] {
    auto result = make_trainable_network(weights.architecture, weights.width, classes,
                                         options.input_px, options.seed);
    import_tensors(*result.module, weights.tensors, "check");
    return result;
  };
  TrainingStep training(options, network(), network(), false);
  stop_dropout(*training.network.module);
  const auto pixels = noise(options.batch, options.input_px);
  const auto truth = some_truth(options.batch, classes, options.input_px);
  const float* first = pixels.data_ptr<float>();
  const auto make = [&](std::int64_t, Batch& batch) {
    batch.pixels.assign(first, first + pixels.numel());
    batch.truth = truth;
  };
  std::vector<double> losses;
  constexpr int kWarm = 3;
  auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < steps; ++i) {
    if (i == kWarm) begin = std::chrono::steady_clock::now();
    losses.push_back(training.advance(make).value_or(std::nan("")));
  }
  if (ms_per_step != nullptr) {
    const std::chrono::duration<double, std::milli> wall =
        std::chrono::steady_clock::now() - begin;
    *ms_per_step = wall.count() / (steps - kWarm);
  }
  return losses;
}

}  // namespace

void check_steps(const std::string& name, const DetectorWeights& weights,
                 ComputeDevice device) {
  constexpr int kSteps = 4, kSide_px = 128, kBatch = 4;
  const auto cpu =
      losses_of(weights, step_options(ComputeDevice::kCpu, false, kSide_px, kBatch), kSteps);
  const auto other = losses_of(weights, step_options(device, false, kSide_px, kBatch), kSteps);
  // On one device nothing is left to chance. Between two, the first loss differs by the order
  // of sums (2e-7 of it measured for the small network; the limit leaves room for the deeper
  // one and other GPUs, and is far below what a wrong layer does). The step after it need not
  // be that close: AdamW makes a whole step of a derivative's sign, also where the derivative
  // is nothing but rounding. 3e-5 was measured for the small network after three such steps.
  const bool same_device = device == ComputeDevice::kCpu;
  for (int i = 0; i < kSteps; ++i) {
    expect_below(name + " step " + std::to_string(i + 1) + ", loss, relative",
                 std::abs(cpu[i] - other[i]) / cpu[i],
                 same_device ? 0.0
                 : i == 0    ? 1e-4
                             : 1e-2);
  }
  if (same_device) return;
  constexpr int kMany = 60;
  const auto plain = losses_of(weights, step_options(device, false, kSide_px, kBatch), kMany);
  const auto mixed = losses_of(weights, step_options(device, true, kSide_px, kBatch), kMany);
  // float16 has 11 bits: each layer rounds by up to 5e-4 of its values. 2e-4 was measured.
  expect_below(name + " mixed precision, first loss, relative",
               std::abs(plain[0] - mixed[0]) / plain[0], 1e-2);
  // That training works at all. Two runs by heart part soon and end within some tens of per
  // cent of each other (1.16 and 0.98 measured), so the last limit is a coarse one.
  expect_below(name + " mixed precision, loss after 60 steps over that at first",
               mixed.back() / mixed.front(), 0.8);
  expect_below(name + " loss after 60 steps, mixed over full precision",
               mixed.back() / plain.back(), 1.5);
}

void time_training(const std::string& name, const DetectorWeights& weights, int batch) {
  for (const bool mixed : {false, true}) {
    double ms = 0.0;
    (void)losses_of(
        weights, step_options(ComputeDevice::kCuda, mixed, weights.input_px, batch), 15, &ms);
    std::printf("time %s training step, %d px, batch %d, %s: %.1f ms\n", name.c_str(),
                weights.input_px, batch, mixed ? "mixed" : "float32", ms);
    std::fflush(stdout);
  }
}

}  // namespace segsim::perception::checks
