#pragma once

/// @file
/// Statistics of success rates over several fine-tunings. One fine-tuning is one random draw:
/// what differs between trainings belongs into the interval and into the test, beside what
/// differs between episodes. docs/metrics.md, "Intervals and tests with several trainings",
/// has the formulas, their sources and what was measured.
///
/// The design is crossed: every training is tested on the same episodes. Trainings, and with
/// several reconstructions those, are draws from all that could have been; so are episodes.
/// Scenes are draws too where there are kScenesForClaim or more; fewer are taken as the only
/// ones that matter, because the spread of so few says nothing of others.

#include <span>

#include "experiments/results/statistics.h"

namespace segsim::experiments::results {

/// One value, a success (0 or 1) or a difference after - before, and where it belongs. Each
/// place may occur once.
struct SeededValue {
  int reconstruction = 0;
  int training = 0;  ///< Within its reconstruction: equal numbers in two are two trainings.
  int scene = 0;
  int episode = 0;  ///< Within its scene; the same episode under every training.
  double value = 0.0;
};

/// Mean of differences with a Student interval whose variance is that of a hierarchical
/// bootstrap over reconstructions, trainings, scenes and episodes, in closed form: nothing is
/// drawn. With one training it is the interval of the episodes alone. Its mean is that of all
/// values. Values without any spread that can be differences of successes (at most 1 in size)
/// leave room for what Wilson's interval says so few episodes can have missed. Not cut off at
/// -1 and 1. Zeros for no values.
[[nodiscard]] MeanInterval hierarchical_interval(std::span<const SeededValue> differences,
                                                 double confidence = 0.95);

/// The same for successes (or other values in [0, 1]): Wilson's interval for the number of
/// independent trials that the values are worth. With one training and fewer than
/// kScenesForClaim scenes it is wilson_interval(). [0, 1] for no values.
[[nodiscard]] MeanInterval hierarchical_rate_interval(std::span<const SeededValue> successes,
                                                      double confidence = 0.95);

/// Is the mean over trainings and episodes 0?
struct TrainingTest {
  double p = 1.0;                   ///< Two-sided.
  double degrees_of_freedom = 0.0;  ///< 0 where there was nothing to test.
  /// Between trainings and between episodes, without the chance of a single trial; all
  /// trainings of all reconstructions together.
  double training_sd = 0.0, episode_sd = 0.0;
};

/// Two-sided test of mean(after - before) = 0 over trainings and episodes, both as random
/// effects. Episodes that miss a value under some training are left out. Never below the
/// p-value of the sign test if all episodes with any difference agreed, so fewer than
/// kMinDiscordantPairs such episodes are never significant. One training says nothing of
/// training: p is 1 with 0 degrees of freedom there, episode_sd contains the chance of single
/// trials, and the caller takes mcnemar_exact_p().
[[nodiscard]] TrainingTest training_test(std::span<const SeededValue> differences);

}  // namespace segsim::experiments::results
