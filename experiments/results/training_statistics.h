#pragma once

/// @file
/// Statistics of success rates over several fine-tunings. One fine-tuning is one random draw:
/// what differs between trainings belongs into the interval and into the test, beside what
/// differs between episodes. docs/metrics.md, "Intervals and tests with several trainings".
///
/// The design is crossed: every training is tested on the same episodes.

#include <span>

#include "experiments/results/statistics.h"

namespace segsim::experiments {

/// One value, a success (0 or 1) or a difference after - before, and where it belongs.
struct SeededValue {
  int reconstruction = 0;
  int training = 0;  ///< Within its reconstruction: equal numbers in two are two trainings.
  int scene = 0;
  int episode = 0;  ///< Within its scene; the same episode under every training.
  double value = 0.0;
};

/// Mean of the values with an interval that knows of reconstructions, trainings, scenes and
/// episodes. With one training it is the interval of the episodes alone.
[[nodiscard]] MeanInterval hierarchical_interval(std::span<const SeededValue> values,
                                                 double confidence = 0.95, int rounds = 2000,
                                                 unsigned seed = 1);

/// Is the mean over trainings and episodes 0?
struct TrainingTest {
  double p = 1.0;                   ///< Two-sided.
  double degrees_of_freedom = 0.0;  ///< 0 where there was nothing to test.
  double training_sd = 0.0;  ///< Standard deviation between trainings, of the differences.
  double episode_sd = 0.0;   ///< Standard deviation between episodes.
};

/// Two-sided test of mean(after - before) = 0 over trainings and episodes. Episodes that miss
/// a value under some training are left out. One training says nothing of training: p is 1
/// with 0 degrees of freedom there, and the caller takes mcnemar_exact_p().
[[nodiscard]] TrainingTest training_test(std::span<const SeededValue> differences);

}  // namespace segsim::experiments
