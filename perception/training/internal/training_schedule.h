#pragma once

/// @file
/// Rates of one step, as plain arithmetic.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "perception/training/training.h"

namespace segsim::perception {

struct StepRates {
  double rate = 0.0;       ///< Of weights.
  double bias_rate = 0.0;  ///< Of biases.
  double momentum = 0.0;
};

/// Linear warm-up times decay. The first step has 1 / (warmup_steps + 1) of the rate: the
/// published schedule starts at 0, a step without effect, and decays by epochs instead of
/// steps.
[[nodiscard]] inline StepRates rates_at(const TrainOptions& o, std::int64_t step) {
  const double warm = std::min(1.0, static_cast<double>(step + 1) / (o.warmup_steps + 1));
  const double phase = static_cast<double>(step) / o.steps;
  const double fall = o.schedule == Schedule::kCosine
                          ? 0.5 * (1.0 + std::cos(std::numbers::pi * phase))
                          : 1.0 - phase;
  const double decay = o.final_rate_share + (1.0 - o.final_rate_share) * fall;
  StepRates rates;
  rates.rate = o.learning_rate * warm * decay;
  rates.bias_rate = o.warmup_bias_rate * (1.0 - warm) + rates.rate;
  rates.momentum = o.warmup_momentum + (o.momentum - o.warmup_momentum) * warm;
  return rates;
}

/// Share of the newest weights in the average after `updates` steps (1 = the first).
[[nodiscard]] inline double average_follow(const TrainOptions& o, std::int64_t updates) {
  const double ramp = 1.0 - std::exp(-static_cast<double>(updates) / o.ema_ramp_steps);
  return 1.0 - o.ema_decay * ramp;
}

/// Batches whose gradients make one step.
[[nodiscard]] inline int batches_per_step(const TrainOptions& o) {
  if (o.nominal_batch <= 0) return 1;
  return std::max(1, static_cast<int>(std::lround(double(o.nominal_batch) / o.batch)));
}

/// The published rule: the decay that is written is for a step of `nominal_batch` images.
[[nodiscard]] inline double step_weight_decay(const TrainOptions& o) {
  if (o.nominal_batch <= 0) return o.weight_decay;
  return o.weight_decay * batches_per_step(o) * o.batch / o.nominal_batch;
}

}  // namespace segsim::perception
