#include "experiments/results/training_statistics.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>

#include "core/check.h"
#include "core/random.h"

namespace segsim::experiments {
namespace {

/// rows[episode][training], all in one scene and one reconstruction.
std::vector<results::SeededValue> one_scene(const std::vector<std::vector<double>>& rows) {
  std::vector<results::SeededValue> values;
  for (std::size_t e = 0; e < rows.size(); ++e) {
    for (std::size_t t = 0; t < rows[e].size(); ++t) {
      values.push_back({0, static_cast<int>(t), 0, static_cast<int>(e), rows[e][t]});
    }
  }
  return values;
}

/// Trainings succeed in 1, 1/2 and 0 of the episodes, episodes in 1, 2/3, 1/3 and 0:
/// MS(training) = 4 (1/4 + 0 + 1/4) / 2 = 1, MS(episode) = 3 (1/4 + 1/36 + 1/36 + 1/4) / 3 =
/// 5/9, all squares 5, so MS(interaction) = (5 - 2 - 5/3) / 6 = 2/9.
std::vector<results::SeededValue> worked_example() {
  return one_scene({{1, 1, 1}, {1, 1, 0}, {1, 0, 0}, {1, 0, -1}});
}

/// Simpson's rule over Student's density.
double student_tail_by_integration(double t, double df) {
  const auto density = [&](double x) {
    return std::exp(std::lgamma(0.5 * (df + 1.0)) - std::lgamma(0.5 * df)) /
           std::sqrt(df * std::numbers::pi) * std::pow(1.0 + x * x / df, -0.5 * (df + 1.0));
  };
  constexpr int kSteps = 2000;
  double sum = density(0.0) + density(t);
  for (int i = 1; i < kSteps; ++i) sum += (i % 2 == 1 ? 4.0 : 2.0) * density(t * i / kSteps);
  return 1.0 - 2.0 * sum * t / kSteps / 3.0;
}

TEST(TrainingStatistics, VarianceComponentsByHand) {
  // Variance of the mean: (1 + (5/9 - 2/9)) / 12 = 1/9. Three quarters of it are the
  // trainings': 1 / (0.75 / 2 + 0.25^2 / 3) = 48/19 degrees of freedom.
  const results::MeanInterval found = results::hierarchical_interval(worked_example(), 0.9);
  const double half = results::student_quantile(0.95, 48.0 / 19.0) / 3.0;
  EXPECT_NEAR(found.mean, 0.5, 1e-12);
  EXPECT_NEAR(found.interval.low, 0.5 - half, 1e-12);
  EXPECT_NEAR(found.interval.high, 0.5 + half, 1e-12);

  // Two half episodes add 1/4^2: 25/144, of which the trainings' share is 12/25, so t = 6/5
  // with 1 / (0.48 / 2 + 0.52^2 / 3) = 1875/619 degrees of freedom.
  const results::TrainingTest test = results::training_test(worked_example());
  EXPECT_NEAR(test.degrees_of_freedom, 1875.0 / 619.0, 1e-12);
  EXPECT_NEAR(test.p, student_tail_by_integration(1.2, 1875.0 / 619.0), 1e-9);
  EXPECT_NEAR(test.training_sd, std::sqrt((1.0 - 2.0 / 9.0) / 4.0), 1e-12);
  EXPECT_NEAR(test.episode_sd, std::sqrt((5.0 / 9.0 - 2.0 / 9.0) / 3.0), 1e-12);

  // Values that are no successes, as seconds, have no half episodes: t = (1/2) / (1/3).
  std::vector<results::SeededValue> seconds = worked_example();
  for (results::SeededValue& v : seconds) v.value *= 10.0;
  EXPECT_NEAR(results::training_test(seconds).p, student_tail_by_integration(1.5, 48.0 / 19.0),
              1e-9);
  EXPECT_NEAR(results::training_test(seconds).training_sd, 10.0 * test.training_sd, 1e-12);
}

TEST(TrainingStatistics, RatesTakeWilsonsIntervalOfFewerTrials) {
  // Trainings succeed in 1, 1/2 and 1/4 of the episodes, episodes in 1, 2/3, 1/3 and 1/3.
  const auto values = one_scene({{1, 1, 1}, {1, 1, 0}, {1, 0, 0}, {1, 0, 0}});
  const double training = 4.0 * (25.0 + 1.0 + 16.0) / 144.0 / 2.0;
  const double episode = 3.0 * (25.0 + 1.0 + 9.0 + 9.0) / 144.0 / 3.0;
  const double all = 12.0 * 7.0 / 12.0 * 5.0 / 12.0;
  const double rest = (all - 2.0 * training - 3.0 * episode) / 6.0;
  const double sum = training + episode - rest;
  const double share = training / sum;
  const double df = 1.0 / (share / 2.0 + (1.0 - share) * (1.0 - share) / 3.0);
  const double trials = 35.0 / 144.0 / (sum / 12.0);
  EXPECT_LT(trials, 12.0);
  const results::Interval expected =
      results::score_interval(7.0 / 12.0, trials, results::student_quantile(0.975, df));
  const results::MeanInterval found = results::hierarchical_rate_interval(values);
  EXPECT_NEAR(found.mean, 7.0 / 12.0, 1e-12);
  EXPECT_NEAR(found.interval.low, expected.low, 1e-12);
  EXPECT_NEAR(found.interval.high, expected.high, 1e-12);
}

/// Variance of the mean over `rounds` draws of a bootstrap that draws trainings, episodes
/// within their scene, or both. values[scene][episode][training].
double drawn_variance(const std::vector<std::vector<std::vector<double>>>& values,
                      bool trainings, bool episodes, int rounds) {
  core::RandomStream random(7, "oracle", (trainings ? 1U : 0U) + (episodes ? 2U : 0U));
  const auto n = static_cast<std::uint32_t>(values[0][0].size());
  double sum = 0.0, squares = 0.0;
  for (int round = 0; round < rounds; ++round) {
    std::vector<std::size_t> drawn(n);
    for (std::size_t t = 0; t < n; ++t) drawn[t] = trainings ? random.index(n) : t;
    double total = 0.0, count = 0.0;
    for (const auto& scene : values) {
      for (std::size_t e = 0; e < scene.size(); ++e) {
        const auto& row =
            scene[episodes ? random.index(static_cast<std::uint32_t>(scene.size())) : e];
        for (const std::size_t t : drawn) total += row[t];
        count += n;
      }
    }
    sum += total / count;
    squares += total / count * (total / count);
  }
  return squares / rounds - sum / rounds * (sum / rounds);
}

TEST(TrainingStatistics, AgreesWithBootstrapsThatAreDrawn) {
  // A bootstrap of n draws misses a share 1/n of a variance. That of trainings and that of
  // episodes both contain the interaction; what drawing both adds to their sum is it again.
  constexpr int kTrainings = 4, kEpisodes = 6;
  core::RandomStream random(3, "cells");
  std::vector<double> of_training;
  for (int t = 0; t < kTrainings; ++t) of_training.push_back(0.6 * random.normal());
  std::vector<std::vector<std::vector<double>>> values(2);
  std::vector<results::SeededValue> seeded;
  for (int s = 0; s < 2; ++s) {
    for (int e = 0; e < kEpisodes; ++e) {
      const double of_episode = s + random.normal();
      std::vector<double> row;
      for (int t = 0; t < kTrainings; ++t) {
        row.push_back(of_training[static_cast<std::size_t>(t)] + of_episode + random.normal());
        seeded.push_back({0, t, s, e, row.back()});
      }
      values[static_cast<std::size_t>(s)].push_back(row);
    }
  }
  constexpr int kRounds = 20000;
  const double trainings = drawn_variance(values, true, false, kRounds);
  const double episodes = drawn_variance(values, false, true, kRounds);
  const double both = drawn_variance(values, true, true, kRounds);
  const double more_trainings = kTrainings / (kTrainings - 1.0);
  const double more_episodes = kEpisodes / (kEpisodes - 1.0);
  const double expected = more_trainings * trainings + more_episodes * episodes -
                          more_trainings * more_episodes * (both - trainings - episodes);
  const results::MeanInterval found = results::hierarchical_interval(seeded);
  const double half = 0.5 * (found.interval.high - found.interval.low);
  // Values beyond 1 are no successes, so the test has the degrees of the interval.
  const double quantile =
      results::student_quantile(0.975, results::training_test(seeded).degrees_of_freedom);
  EXPECT_NEAR(half * half / (quantile * quantile), expected, 0.05 * expected);
}

TEST(TrainingStatistics, OneTrainingIsTheIntervalOfItsEpisodes) {
  std::vector<results::SeededValue> successes, differences;
  for (int k = 0; k < 20; ++k) {
    successes.push_back({2, 5, k % 2, k, k < 14 ? 1.0 : 0.0});
    differences.push_back({2, 5, 0, k, k < 9 ? 1.0 : (k < 11 ? -1.0 : 0.0)});
  }
  const results::Interval wilson = results::wilson_interval({14, 20});
  const results::MeanInterval rate = results::hierarchical_rate_interval(successes);
  EXPECT_EQ(rate.mean, 0.7);
  EXPECT_NEAR(rate.interval.low, wilson.low, 1e-12);
  EXPECT_NEAR(rate.interval.high, wilson.high, 1e-12);
  // Differences of mean 7/20 and variance (11 - 49/20) / 19, as in Student's one-sample test.
  const results::MeanInterval difference = results::hierarchical_interval(differences);
  const double half =
      results::student_quantile(0.975, 19) * std::sqrt((11.0 - 49.0 / 20.0) / 19.0 / 20.0);
  EXPECT_NEAR(difference.interval.low, 0.35 - half, 1e-12);
  EXPECT_NEAR(difference.interval.high, 0.35 + half, 1e-12);
  const results::TrainingTest test = results::training_test(differences);
  EXPECT_EQ(test.p, 1.0);
  EXPECT_EQ(test.degrees_of_freedom, 0.0);
  EXPECT_EQ(test.training_sd, 0.0);
  EXPECT_NEAR(test.episode_sd, std::sqrt((11.0 - 49.0 / 20.0) / 19.0), 1e-12);
}

TEST(TrainingStatistics, NothingToTestIsDefined) {
  EXPECT_EQ(results::hierarchical_interval({}).mean, 0.0);
  EXPECT_EQ(results::hierarchical_interval({}).interval.high, 0.0);
  EXPECT_EQ(results::hierarchical_rate_interval({}).interval.low, 0.0);
  EXPECT_EQ(results::hierarchical_rate_interval({}).interval.high, 1.0);
  EXPECT_EQ(results::training_test({}).p, 1.0);
  EXPECT_EQ(results::training_test({}).degrees_of_freedom, 0.0);
  // One episode on which the trainings agree.
  EXPECT_EQ(results::training_test(one_scene({{1, 1, 1}})).p, 1.0);
  EXPECT_EQ(results::training_test(one_scene({{1, 1, 1}})).degrees_of_freedom, 2.0);
  // No episode has both trainings.
  const std::vector<results::SeededValue> apart{{0, 0, 0, 0, 1.0}, {0, 1, 0, 1, 1.0}};
  EXPECT_EQ(results::training_test(apart).p, 1.0);
  const std::vector<results::SeededValue> twice{{0, 0, 0, 3, 1.0}, {0, 0, 0, 3, 0.0}};
  EXPECT_THROW((void)results::hierarchical_interval(twice), core::ContractViolation);
  const std::vector<results::SeededValue> no_rate{{0, 0, 0, 0, 1.0}, {0, 0, 0, 1, -1.0}};
  EXPECT_THROW((void)results::hierarchical_rate_interval(no_rate), core::ContractViolation);
}

TEST(TrainingStatistics, EqualValuesStillLeaveRoomForOtherEpisodes) {
  const std::vector<std::vector<double>> same(20, {0.0, 0.0, 0.0});
  const double others = results::wilson_interval({0, 20}).high;
  const results::MeanInterval none = results::hierarchical_interval(one_scene(same));
  EXPECT_NEAR(none.interval.low, -others, 1e-12);
  EXPECT_NEAR(none.interval.high, others, 1e-12);
  EXPECT_EQ(results::training_test(one_scene(same)).p, 1.0);
  const std::vector<std::vector<double>> ones(20, {1.0, 1.0, 1.0});
  const results::MeanInterval all = results::hierarchical_interval(one_scene(ones));
  EXPECT_NEAR(all.interval.low, 1.0 - 2.0 * others, 1e-12);
  EXPECT_NEAR(all.interval.high, 1.0, 1e-12);
  EXPECT_NEAR(results::training_test(one_scene(ones)).p, std::exp2(-19), 1e-12);
  const results::MeanInterval rate = results::hierarchical_rate_interval(one_scene(ones));
  EXPECT_NEAR(rate.interval.low, results::wilson_interval({20, 20}).low, 1e-12);
  // Seconds have no bounds to argue from.
  const std::vector<std::vector<double>> seconds(20, {2.5, 2.5, 2.5});
  EXPECT_EQ(results::hierarchical_interval(one_scene(seconds)).interval.high, 2.5);
}

TEST(TrainingStatistics, FewDifferingEpisodesAreNeverSignificant) {
  for (int differing = 0; differing <= 8; ++differing) {
    std::vector<std::vector<double>> rows(12, {0.0, 0.0, 0.0, 0.0});
    for (int e = 0; e < differing; ++e) rows[static_cast<std::size_t>(e)] = {1, 1, 1, 1};
    const double p = results::training_test(one_scene(rows)).p;
    EXPECT_GE(p, results::mcnemar_exact_p(differing, 0) - 1e-12) << differing;
    EXPECT_EQ(p < 0.05, differing >= results::kMinDiscordantPairs) << differing;
  }
}

TEST(TrainingStatistics, OrderAndNumbersDoNotMatter) {
  std::vector<results::SeededValue> values = worked_example();
  const results::TrainingTest expected = results::training_test(values);
  const results::MeanInterval interval = results::hierarchical_interval(values);
  std::reverse(values.begin(), values.end());
  std::swap(values[2], values[9]);
  for (results::SeededValue& v : values) {
    v.training = 10 - 3 * v.training;
    v.episode = 7 * v.episode - 100;
    v.scene = -4;
    v.reconstruction = 11;
  }
  EXPECT_EQ(results::training_test(values).p, expected.p);
  EXPECT_EQ(results::hierarchical_interval(values).interval.low, interval.interval.low);
}

TEST(TrainingStatistics, AnEpisodeWithoutAllTrainingsIsLeftOutOfTheTest) {
  std::vector<results::SeededValue> values = worked_example();
  const results::TrainingTest expected = results::training_test(values);
  values.push_back({0, 0, 0, 4, -1.0});
  values.push_back({0, 2, 0, 4, -1.0});
  EXPECT_EQ(results::training_test(values).p, expected.p);
  EXPECT_EQ(results::training_test(values).degrees_of_freedom, expected.degrees_of_freedom);
  // The interval keeps it: its mean is that of all values, as printed beside it.
  EXPECT_NEAR(results::hierarchical_interval(values).mean, 4.0 / 14.0, 1e-12);
}

TEST(TrainingStatistics, ReconstructionsAreDrawnBeforeTrainings) {
  // Three reconstructions with two trainings each that agree: as three trainings.
  std::vector<results::SeededValue> values, twice;
  for (const results::SeededValue& v : worked_example()) {
    values.push_back({v.training, 0, 0, v.episode, v.value});
    for (int t = 0; t < 2; ++t) twice.push_back({v.training, t, 0, v.episode, v.value});
  }
  const results::MeanInterval expected = results::hierarchical_interval(worked_example());
  for (const auto& several : {values, twice}) {
    const results::MeanInterval found = results::hierarchical_interval(several);
    EXPECT_NEAR(found.interval.low, expected.interval.low, 1e-12);
    EXPECT_NEAR(found.interval.high, expected.interval.high, 1e-12);
    EXPECT_NEAR(results::training_test(several).p, results::training_test(values).p, 1e-12);
    // "Before" was run three times.
    EXPECT_LT(results::training_test(several).p, results::training_test(worked_example()).p);
  }
  // Six trainings of one reconstruction that agree in pairs say more than that.
  for (results::SeededValue& v : twice)
    v = {0, 2 * v.reconstruction + v.training, 0, v.episode, v.value};
  EXPECT_GT(results::hierarchical_interval(twice).interval.low, expected.interval.low);
}

TEST(TrainingStatistics, FiveScenesAreDrawnFourAreNot) {
  // Scenes differ, their episodes and trainings hardly: only drawn scenes widen the interval.
  const auto width = [](int scenes) {
    std::vector<results::SeededValue> values;
    for (int s = 0; s < scenes; ++s) {
      for (int e = 0; e < 20; ++e) {
        for (int t = 0; t < 3; ++t) {
          values.push_back({0, t, s, e, s + 0.01 * ((e + t) % 2)});
        }
      }
    }
    const results::Interval interval = results::hierarchical_interval(values).interval;
    return interval.high - interval.low;
  };
  EXPECT_LT(width(4), 0.01);
  // Scene means 0 to 4 have variance 5/2: Student's interval of five values.
  EXPECT_NEAR(width(5), 2.0 * results::student_quantile(0.975, 4) * std::sqrt(0.5), 0.01);
}

}  // namespace
}  // namespace segsim::experiments
