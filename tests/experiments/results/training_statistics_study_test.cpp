// How often intervals of trainings cover and tests err, by simulation where the truth is
// known.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include <gtest/gtest.h>

#include "core/random.h"
#include "experiments/results/training_statistics.h"

namespace segsim::experiments {
namespace {

/// Success = a normal number with these parts is positive, as in the standard simulation of
/// readers and cases (Roe & Metz 1997): training + episode + scene + chance.
struct World {
  double rate = 0.5;         ///< Of success, mean over all that is drawn.
  double training_sd = 0.0;  ///< Of the success rates of trainings.
  int trainings = 3, reconstructions = 1;
  int scenes = 2, episodes = 20;
  double before = 0.5;             ///< Success rate of the fixed detector.
  double scene_sd = 0.0;           ///< Against 1 of the chance of a single trial.
  double reconstruction_sd = 0.0;  ///< The same.
};
constexpr double kEpisodeSd = 1.0;

double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

class Simulation {
 public:
  Simulation(const World& world, std::uint64_t seed)
      : world_(world), random_(seed, "world", setting(world)) {
    const double others = 1.0 + kEpisodeSd * kEpisodeSd + world.scene_sd * world.scene_sd +
                          world.reconstruction_sd * world.reconstruction_sd;
    double low = 0.0, high = 8.0;
    for (int k = 0; k < 40; ++k) {
      const double middle = 0.5 * (low + high);
      (sd_of_rates(middle, others) < world.training_sd ? low : high) = middle;
    }
    training_sd_ = low;
    level_ = results::normal_quantile(world.rate) * std::sqrt(others + low * low);
    level_before_ = results::normal_quantile(world.before) * std::sqrt(others);
  }

  /// Draws one experiment into `after` (successes) and `difference`.
  void draw() {
    after.clear();
    difference.clear();
    only_after = only_before = 0;
    std::vector<double> episode;
    for (int s = 0; s < world_.scenes; ++s) {
      const double scene = world_.scene_sd * random_.normal();
      for (int e = 0; e < world_.episodes; ++e) {
        episode.push_back(scene + kEpisodeSd * random_.normal());
      }
    }
    for (int r = 0; r < world_.reconstructions; ++r) {
      const double place = world_.reconstruction_sd * random_.normal();
      std::vector<double> before;
      for (const double e : episode) before.push_back(trial(level_before_ + place + e));
      for (int t = 0; t < world_.trainings; ++t) {
        const double training = level_ + place + training_sd_ * random_.normal();
        for (std::size_t k = 0; k < episode.size(); ++k) {
          const int scene = static_cast<int>(k) / world_.episodes;
          const double success = trial(training + episode[k]);
          after.push_back({r, t, scene, static_cast<int>(k), success});
          difference.push_back({r, t, scene, static_cast<int>(k), success - before[k]});
          only_after += success > before[k] ? 1 : 0;
          only_before += success < before[k] ? 1 : 0;
        }
      }
    }
  }

  std::vector<results::SeededValue> after, difference;
  int only_after = 0, only_before = 0;  ///< Over all trainings.

 private:
  /// Standard deviation of the success rates of trainings whose parts have the deviation `sd`.
  [[nodiscard]] double sd_of_rates(double sd, double others) const {
    const double level = results::normal_quantile(world_.rate) * std::sqrt(others + sd * sd);
    double weights = 0.0, sum = 0.0, squares = 0.0;
    for (double z = -6.0; z <= 6.0; z += 0.05) {
      const double weight = std::exp(-0.5 * z * z);
      const double rate = normal_cdf((level + sd * z) / std::sqrt(others));
      weights += weight;
      sum += weight * rate;
      squares += weight * rate * rate;
    }
    return std::sqrt(std::max(0.0, squares / weights - sum / weights * (sum / weights)));
  }
  /// Different worlds have different random numbers.
  static std::uint64_t setting(const World& w) {
    return static_cast<std::uint64_t>(1000.0 * w.rate + 1e5 * w.training_sd) * 100000 +
           static_cast<std::uint64_t>(w.trainings * 100 + w.reconstructions * 10 + w.scenes);
  }
  double trial(double level) { return random_.chance(normal_cdf(level)) ? 1.0 : 0.0; }

  World world_;
  core::RandomStream random_;
  double training_sd_ = 0.0, level_ = 0.0, level_before_ = 0.0;
};

/// Percentages of the experiments in which the truth was covered, and in which a test said
/// p < 0.05.
struct Shares {
  double rate = 0.0, difference = 0.0, rejected = 0.0, mcnemar = 0.0;
};

constexpr int kRounds = 2000;
constexpr double kStudyError = 0.5;  ///< Binomial, in points, of a share of 95 %.

Shares study(const World& world) {
  Simulation simulation(world, 1);
  Shares shares;
  const auto covers = [](const results::Interval& interval, double truth) {
    return interval.low <= truth && truth <= interval.high ? 100.0 / kRounds : 0.0;
  };
  for (int round = 0; round < kRounds; ++round) {
    simulation.draw();
    shares.rate +=
        covers(results::hierarchical_rate_interval(simulation.after).interval, world.rate);
    shares.difference += covers(results::hierarchical_interval(simulation.difference).interval,
                                world.rate - world.before);
    shares.rejected +=
        results::training_test(simulation.difference).p < 0.05 ? 100.0 / kRounds : 0.0;
    shares.mcnemar +=
        results::mcnemar_exact_p(simulation.only_after, simulation.only_before) < 0.05
            ? 100.0 / kRounds
            : 0.0;
  }
  std::printf(
      "rate %.2f before %.2f sd %.2f, %d x %d trainings, %d scenes: covered %.1f and "
      "%.1f, p < 0.05 in %.1f, McNemar pooled %.1f\n",
      world.rate, world.before, world.training_sd, world.reconstructions, world.trainings,
      world.scenes, shares.rate, shares.difference, shares.rejected, shares.mcnemar);
  return shares;
}

/// What a setting must hold, with the error of the study beside it.
void expect_covered(double percent, const World& world) {
  EXPECT_GE(percent, 93.0 - kStudyError) << world.rate << ", " << world.training_sd;
  EXPECT_LE(percent, 97.0 + kStudyError) << world.rate << ", " << world.training_sd;
}

TEST(TrainingStatisticsStudy, IntervalsCoverAndTheTestKeepsItsLevelWhereTrainingsDiffer) {
  double rejected = 0.0;
  int settings = 0;
  for (const double rate : {0.3, 0.5, 0.7, 0.9}) {
    for (const double sd : {0.04, 0.08, 0.12}) {
      for (const int trainings : {3, 5, 10}) {
        const World world{
            .rate = rate, .training_sd = sd, .trainings = trainings, .before = rate};
        const Shares shares = study(world);
        expect_covered(shares.rate, world);
        expect_covered(shares.difference, world);
        EXPECT_LE(shares.rejected, 6.0) << rate << ", " << sd << ", " << trainings;
        if (sd == 0.08) {
          EXPECT_GT(shares.mcnemar, 10.0) << rate << ", " << trainings;
        }
        rejected += shares.rejected;
        ++settings;
      }
    }
  }
  EXPECT_LE(rejected / settings, 5.0);
  EXPECT_GE(rejected / settings, 2.0);  // A test that never rejects would keep its level too.
}

TEST(TrainingStatisticsStudy, NothingIsClaimedWhereTrainingsDoNotDiffer) {
  for (const double rate : {0.3, 0.6, 0.9}) {
    for (const int trainings : {3, 10}) {
      const World world{.rate = rate, .trainings = trainings, .before = rate};
      const Shares shares = study(world);
      EXPECT_GE(shares.rate, 93.0 - kStudyError) << rate << ", " << trainings;
      EXPECT_LE(shares.rejected, 6.0) << rate << ", " << trainings;
    }
  }
}

TEST(TrainingStatisticsStudy, FiveScenesThatDiffer) {
  for (const double rate : {0.4, 0.8}) {
    for (const int trainings : {3, 5, 10}) {
      const World world{.rate = rate,
                        .training_sd = 0.08,
                        .trainings = trainings,
                        .scenes = 5,
                        .before = rate,
                        .scene_sd = 0.5};
      const Shares shares = study(world);
      expect_covered(shares.rate, world);
      expect_covered(shares.difference, world);
      EXPECT_LE(shares.rejected, 6.0) << rate << ", " << trainings;
    }
  }
}

TEST(TrainingStatisticsStudy, ThreeReconstructionsThatDiffer) {
  for (const double rate : {0.4, 0.8}) {
    for (const double reconstruction_sd : {0.0, 0.3}) {
      const World world{.rate = rate,
                        .training_sd = 0.08,
                        .trainings = 3,
                        .reconstructions = 3,
                        .before = rate,
                        .reconstruction_sd = reconstruction_sd};
      const Shares shares = study(world);
      expect_covered(shares.rate, world);
      expect_covered(shares.difference, world);
      EXPECT_LE(shares.rejected, 6.0) << rate << ", " << reconstruction_sd;
    }
  }
}

TEST(TrainingStatisticsStudy, ThirtyPointsAreFound) {
  const World three{.rate = 0.8, .training_sd = 0.08, .trainings = 3, .before = 0.5};
  World five = three;
  five.trainings = 5;
  EXPECT_GE(study(three).rejected, 70.0);
  EXPECT_GE(study(five).rejected, 88.0);
}

}  // namespace
}  // namespace segsim::experiments
