#include "experiments/results/statistics.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "core/check.h"
#include "core/random.h"

namespace segsim::experiments {
namespace {

struct IntervalCase {
  int k, n;
  double wilson_low, wilson_high, exact_low, exact_high;
};

// Computed independently with scipy.stats (binomtest.proportion_ci).
constexpr IntervalCase kIntervals[] = {
    {0, 10, 0, .2775, 0, .3085},
    {9, 10, .5958, .9821, .5550, .9975},
    {5, 5, .5655, 1, .4782, 1},
    {10, 20, .2993, .7007, .2720, .7280},
    {25, 100, .1755, .3430, .1688, .3466},
    {1050, 2000, .5031, .5468, .5028, .5471},
};

TEST(Statistics, IntervalsHaveTheReferenceValues) {
  for (const IntervalCase& c : kIntervals) {
    const results::Interval wilson = results::wilson_interval({c.k, c.n});
    const results::Interval exact = results::clopper_pearson_interval({c.k, c.n});
    EXPECT_NEAR(wilson.low, c.wilson_low, 6e-5) << c.k << "/" << c.n;
    EXPECT_NEAR(wilson.high, c.wilson_high, 6e-5) << c.k << "/" << c.n;
    EXPECT_NEAR(exact.low, c.exact_low, 6e-5) << c.k << "/" << c.n;
    EXPECT_NEAR(exact.high, c.exact_high, 6e-5) << c.k << "/" << c.n;
  }
}

TEST(Statistics, IntervalsAreExactAtTheEndsAndStayInTheUnitRange) {
  for (int n = 1; n <= 60; ++n) {
    EXPECT_EQ(results::wilson_interval({0, n}).low, 0.0);
    EXPECT_EQ(results::wilson_interval({n, n}).high, 1.0);
    EXPECT_EQ(results::clopper_pearson_interval({0, n}).low, 0.0);
    EXPECT_EQ(results::clopper_pearson_interval({n, n}).high, 1.0);
    for (int k = 0; k <= n; ++k) {
      const double p = static_cast<double>(k) / n;
      for (const results::Interval& interval :
           {results::wilson_interval({k, n}), results::clopper_pearson_interval({k, n})}) {
        EXPECT_GE(interval.low, 0.0);
        EXPECT_LE(interval.low, p);
        EXPECT_GE(interval.high, p);
        EXPECT_LE(interval.high, 1.0);
      }
    }
  }
  EXPECT_EQ(results::wilson_interval({0, 0}).low, 0.0);
  EXPECT_EQ(results::clopper_pearson_interval({0, 0}).high, 1.0);
  EXPECT_THROW((void)results::wilson_interval({3, 2}), core::ContractViolation);
}

TEST(Statistics, HalfWidthsOfWilsonAtOneHalf) {
  const std::pair<int, double> expected[] = {{20, .20},   {50, .13},   {100, .096},
                                             {200, .069}, {500, .044}, {2000, .022}};
  for (const auto& [n, half] : expected) {
    const results::Interval interval = results::wilson_interval({n / 2, n});
    EXPECT_NEAR(0.5 * (interval.high - interval.low), half, n <= 50 ? 5e-3 : 6e-4) << n;
  }
}

TEST(Statistics, IncompleteBetaAgreesWithTheBinomialSum) {
  // P(X >= k) for X ~ Binomial(n, x) equals I_x(k, n - k + 1).
  for (const double x : {0.05, 0.3, 0.5, 0.77, 0.98}) {
    for (int n = 1; n <= 40; n += 3) {
      for (int k = 1; k <= n; k += 2) {
        double tail = 0.0;
        for (int i = k; i <= n; ++i) {
          tail += std::exp(std::lgamma(n + 1.0) - std::lgamma(i + 1.0) -
                           std::lgamma(n - i + 1.0)) *
                  std::pow(x, i) * std::pow(1.0 - x, n - i);
        }
        EXPECT_NEAR(results::incomplete_beta(k, n - k + 1.0, x), tail, 1e-11);
      }
    }
  }
  EXPECT_NEAR(
      results::incomplete_beta(2.5, 3.5, results::inverse_incomplete_beta(2.5, 3.5, 0.123)),
      0.123, 1e-12);
}

TEST(Statistics, NormalQuantileInvertsTheDistribution) {
  EXPECT_NEAR(results::normal_quantile(0.975), 1.959963984540054, 1e-12);
  EXPECT_NEAR(results::normal_quantile(0.8), 0.8416212335729143, 1e-12);
  for (double x = -5.0; x <= 5.0; x += 0.25) {
    EXPECT_NEAR(results::normal_quantile(0.5 * std::erfc(-x / std::sqrt(2.0))), x, 1e-9);
  }
}

TEST(Statistics, StudentHasTheTabledQuantiles) {
  EXPECT_NEAR(results::student_quantile(.975, 1), 12.7062, 5e-5);
  EXPECT_NEAR(results::student_quantile(.975, 2), 4.30265, 5e-6);
  EXPECT_NEAR(results::student_quantile(.95, 5), 2.01505, 5e-6);
  EXPECT_NEAR(results::student_quantile(.025, 39), -2.02269, 5e-6);
  EXPECT_NEAR(results::student_quantile(.975, 1e6), results::normal_quantile(.975), 1e-5);
  EXPECT_NEAR(results::student_quantile(.5, 7), 0.0, 1e-9);
  // One degree: Cauchy, P(|T| > 1) = 1/2. Two degrees: P(|T| > t) = 1 - t / sqrt(2 + t^2).
  EXPECT_NEAR(results::student_two_sided_p(1.0, 1), 0.5, 1e-12);
  EXPECT_NEAR(results::student_two_sided_p(-3.0, 2), 1.0 - 3.0 / std::sqrt(11.0), 1e-12);
  EXPECT_EQ(results::student_two_sided_p(0.0, 4.5), 1.0);
  for (const double df : {0.7, 1.0, 2.6, 11.0, 200.0}) {
    EXPECT_NEAR(results::student_two_sided_p(results::student_quantile(.99, df), df), .02,
                1e-10)
        << df;
  }
}

TEST(Statistics, ScoreIntervalSolvesItsEquation) {
  // Its ends are the rates from which `rate` lies `quantile` standard errors away.
  const double rate = 0.3, trials = 27.5, quantile = 2.4;
  const results::Interval found = results::score_interval(rate, trials, quantile);
  for (const double end : {found.low, found.high}) {
    EXPECT_NEAR(std::abs(rate - end), quantile * std::sqrt(end * (1 - end) / trials), 1e-12);
  }
  EXPECT_EQ(results::score_interval(0.0, 3.5, 2.0).low, 0.0);
  EXPECT_EQ(results::score_interval(1.0, 3.5, 2.0).high, 1.0);
  EXPECT_THROW((void)results::score_interval(0.5, 0.0, 2.0), core::ContractViolation);
}

struct McNemarCase {
  int b, c;
  double exact, mid, tolerance;
};

TEST(Statistics, McNemarHasTheReferenceValues) {
  const McNemarCase cases[] = {
      {4, 0, .125, .0625, 1e-12},
      {5, 0, .0625, .03125, 1e-12},
      {6, 0, .03125, .015625, 1e-12},
      {8, 0, .0078125, .00390625, 1e-12},
      {6, 1, .125, .0703125, 1e-12},
      {10, 2, .03857, .02246, 6e-6},
      {15, 5, .04139, .02660, 6e-6},
      {12, 5, .14346, .09625, 6e-6},
      {30, 10, .002221, .001450, 6e-7},
      // The even split: C(6, 3) / 64 = .3125 of which one half is left out.
      {1, 1, 1, .75, 1e-12},
      {3, 3, 1, .84375, 1e-12},
      {0, 0, 1, 1, 1e-12},
  };
  for (const McNemarCase& c : cases) {
    EXPECT_NEAR(results::mcnemar_exact_p(c.b, c.c), c.exact, c.tolerance)
        << c.b << ", " << c.c;
    EXPECT_NEAR(results::mcnemar_mid_p(c.b, c.c), c.mid, c.tolerance) << c.b << ", " << c.c;
    EXPECT_EQ(results::mcnemar_exact_p(c.b, c.c), results::mcnemar_exact_p(c.c, c.b));
  }
}

TEST(Statistics, McNemarAgreesWithCountingAllOutcomes) {
  // Each of 2^n ways in which n discordant pairs can fall is as likely as any other.
  for (int n = 1; n <= 12; ++n) {
    for (int b = 0; b <= n; ++b) {
      const int unevenness = std::abs(2 * b - n);
      int more_uneven = 0, as_uneven = 0;
      for (unsigned outcome = 0; outcome < (1U << n); ++outcome) {
        const int other = std::abs(2 * std::popcount(outcome) - n);
        more_uneven += other > unevenness ? 1 : 0;
        as_uneven += other == unevenness ? 1 : 0;
      }
      const double all = std::exp2(n);
      EXPECT_NEAR(results::mcnemar_exact_p(b, n - b), (more_uneven + as_uneven) / all, 1e-12);
      EXPECT_NEAR(results::mcnemar_mid_p(b, n - b), (more_uneven + 0.5 * as_uneven) / all,
                  1e-12);
    }
  }
}

TEST(Statistics, FewerThanSixDiscordantPairsAreNeverSignificant) {
  for (int n = 0; n < results::kMinDiscordantPairs; ++n)
    EXPECT_GE(results::mcnemar_exact_p(n, 0), 0.05);
  EXPECT_LT(results::mcnemar_exact_p(results::kMinDiscordantPairs, 0), 0.05);
}

TEST(Statistics, TheExactTestKeepsItsLevel) {
  // Two equal arms: the share of p < 0.05 over many repeats must not exceed the level by much.
  core::RandomStream random(5, "level");
  int significant = 0;
  for (int repeat = 0; repeat < 1000; ++repeat) {
    int b = 0, c = 0;
    for (int pair = 0; pair < 40; ++pair) {
      const bool first = random.chance(0.5), second = random.chance(0.5);
      b += !first && second ? 1 : 0;
      c += first && !second ? 1 : 0;
    }
    significant += results::mcnemar_exact_p(b, c) < 0.05 ? 1 : 0;
  }
  EXPECT_LE(significant, 60);
  EXPECT_GE(significant, 10);
}

TEST(Statistics, NewcombeHasTheReferenceValues) {
  struct Case {
    results::PairedCounts counts;
    double difference, low, high;
  };
  const Case cases[] = {
      {{1, 4, 0, 0}, .80, .1926, .9638},  {{1, 1, 0, 2}, .25, -.3196, .6553},
      {{5, 5, 0, 10}, .25, .0319, .4337}, {{20, 15, 5, 60}, .10, .0120, .1866},
      {{2, 8, 0, 0}, .80, .3840, .9433},
  };
  for (const Case& c : cases) {
    const results::PairedDifference found = results::newcombe_paired_difference(c.counts);
    EXPECT_NEAR(found.difference, c.difference, 1e-12);
    EXPECT_NEAR(found.interval.low, c.low, 6e-5);
    EXPECT_NEAR(found.interval.high, c.high, 6e-5);
  }
}

TEST(Statistics, SwappingTheArmsMirrorsTheDifference) {
  for (int seed = 0; seed < 50; ++seed) {
    core::RandomStream random(static_cast<std::uint64_t>(seed), "swap");
    const auto draw = [&] { return static_cast<int>(random.index(20)); };
    const results::PairedCounts counts{draw(), draw(), draw(), 1 + draw()};
    const results::PairedCounts swapped{counts.both, counts.only_before, counts.only_after,
                                        counts.neither};
    const results::PairedDifference one = results::newcombe_paired_difference(counts);
    const results::PairedDifference other = results::newcombe_paired_difference(swapped);
    EXPECT_NEAR(one.interval.low, -other.interval.high, 1e-12);
    EXPECT_NEAR(one.interval.high, -other.interval.low, 1e-12);
  }
}

TEST(Statistics, PairsNeededHaveTheReferenceValues) {
  // psi = p_b + p_c and delta = p_b - p_c of (.30, .05), (.25, 0), (.20, .10), (.15, .05).
  EXPECT_EQ(results::pairs_needed(.35, .25), 42);
  EXPECT_EQ(results::pairs_needed(.25, .25), 29);
  EXPECT_EQ(results::pairs_needed(.30, .10), 234);
  EXPECT_EQ(results::pairs_needed(.20, .10), 155);
  // By hand: (1.959964 sqrt(.3) + 1.281552 sqrt(.29))^2 / .01 = 311.05.
  EXPECT_EQ(results::pairs_needed(.30, .10, .9), 312);
  EXPECT_THROW((void)results::pairs_needed(.1, .2), core::ContractViolation);
  EXPECT_THROW((void)results::pairs_needed(.3, .1, 1.0), core::ContractViolation);
}

TEST(Statistics, HolmCorrectionByHand) {
  const std::vector<double> corrected =
      results::holm_correction(std::vector<double>{.04, .01, .03});
  EXPECT_NEAR(corrected[0], .06, 1e-12);  // max(0.03 * 2, 0.04 * 1)
  EXPECT_NEAR(corrected[1], .03, 1e-12);
  EXPECT_NEAR(corrected[2], .06, 1e-12);
}

TEST(Statistics, SignFlipAgreesWithCounting) {
  // Of the 8 sign patterns only +++ and --- reach the observed sum.
  EXPECT_NEAR(results::sign_flip_p(std::vector<double>{1, 2, 3}), 2.0 / 8.0, 1e-12);
  EXPECT_EQ(results::sign_flip_p(std::vector<double>{}), 1.0);
  // A clear shift of 40 values: the random version finds it, and repeats itself.
  const std::vector<double> shift(40, 0.2);
  EXPECT_LT(results::sign_flip_p(shift), 0.001);
  EXPECT_EQ(results::sign_flip_p(shift), results::sign_flip_p(shift));
}

TEST(Statistics, ManyValuesTakeTheNormalLimitWhereDrawsAgree) {
  // One value fewer is drawn, so the two sides of the limit must tell the same story.
  core::RandomStream random(3, "limit");
  std::vector<double> values;
  double sum = 0.0;
  while (values.size() < results::kNormalFrom) {
    values.push_back(random.normal());
    sum += values.back();
  }
  // A mean of 0.04 with a deviation of 1 is 1.265 standard errors of 1000 values: p = 0.206.
  for (double& value : values) value += 0.04 - sum / results::kNormalFrom;
  const std::vector<double> fewer(values.begin(), values.end() - 1);
  EXPECT_NEAR(results::sign_flip_p(values), results::sign_flip_p(fewer), 0.02);
  EXPECT_NEAR(results::sign_flip_p(values), 0.206, 0.02);
  const results::MeanInterval limit = results::bootstrap_mean(values),
                              drawn = results::bootstrap_mean(fewer);
  EXPECT_NEAR(limit.interval.low, drawn.interval.low, 0.005);
  EXPECT_NEAR(limit.interval.high, drawn.interval.high, 0.005);
  EXPECT_EQ(results::sign_flip_p(std::vector<double>(results::kNormalFrom, 0.0)), 1.0);
}

TEST(Statistics, BootstrapOfTwoValuesByHand) {
  // Of 0 and 1 the mean of two draws is 0, 1/2 or 1 with 1/4, 1/2, 1/4: 2.5 % tails reach
  // both.
  const results::MeanInterval two = results::bootstrap_mean(std::vector<double>{0.0, 1.0});
  EXPECT_EQ(two.mean, 0.5);
  EXPECT_EQ(two.interval.low, 0.0);
  EXPECT_EQ(two.interval.high, 1.0);
  const results::MeanInterval one = results::bootstrap_mean(std::vector<double>{0.25});
  EXPECT_EQ(one.interval.low, 0.25);
  EXPECT_EQ(one.interval.high, 0.25);
  EXPECT_EQ(results::bootstrap_mean(std::vector<double>{}).mean, 0.0);
}

TEST(Statistics, BootstrapAgreesWithTheStandardErrorAndCoversTheMean) {
  int covered = 0;
  for (unsigned seed = 0; seed < 200; ++seed) {
    core::RandomStream random(seed, "cover");
    std::vector<double> values;
    double sum = 0.0, squares = 0.0;
    for (int k = 0; k < 60; ++k) {
      values.push_back(2.0 + random.normal());
      sum += values.back();
      squares += values.back() * values.back();
    }
    const double deviation = std::sqrt(squares / 60 - (sum / 60) * (sum / 60));
    const results::MeanInterval found = results::bootstrap_mean(values, 1000, seed);
    EXPECT_NEAR(found.interval.high - found.interval.low,
                2 * 1.96 * deviation / std::sqrt(60.0), 0.1);
    covered += found.interval.low <= 2.0 && 2.0 <= found.interval.high ? 1 : 0;
  }
  EXPECT_GE(covered, 180);
  EXPECT_LE(covered, 199);
}

TEST(Statistics, ClusterBootstrapSeesTheScenesNotTheEpisodes) {
  // Three scenes of 100 equal episodes each: 27 equally likely draws of three scenes.
  const std::vector<results::ClusterSum> scenes{
      {0.0, 100}, {50.0, 100}, {0.0, 0}, {100.0, 100}};
  const results::MeanInterval found = results::cluster_bootstrap_mean(scenes);
  EXPECT_NEAR(found.mean, 0.5, 1e-12);
  // The outermost draws, three times the same scene, have 1/27 > 2.5 % each.
  EXPECT_NEAR(found.interval.low, 0.0, 1e-12);
  EXPECT_NEAR(found.interval.high, 1.0, 1e-12);
  // Taken for independent, the 300 episodes would claim far more.
  std::vector<double> pooled(300, 0.5);
  std::fill_n(pooled.begin(), 100, 0.0);
  std::fill_n(pooled.begin() + 100, 100, 1.0);
  const results::MeanInterval naive = results::bootstrap_mean(pooled);
  EXPECT_LT(naive.interval.high - naive.interval.low, 0.12);
  // A large scene weighs more.
  EXPECT_NEAR(
      results::cluster_bootstrap_mean(std::vector<results::ClusterSum>{{30.0, 30}, {0.0, 10}})
          .mean,
      0.75, 1e-12);
  EXPECT_EQ(results::cluster_bootstrap_mean({}).mean, 0.0);
}

TEST(Statistics, DrawsAreThoseOfThePythonPackage) {
  // tests/python/test_statistics.py expects the same numbers of its own implementation.
  const std::vector<results::ClusterSum> scenes{{7.0, 20},  {12.0, 25}, {3.5, 30},
                                                {18.0, 20}, {9.0, 15},  {1.0, 10}};
  const results::MeanInterval found = results::cluster_bootstrap_mean(scenes);
  EXPECT_NEAR(found.mean, 0.42083333333333334, 1e-12);
  EXPECT_NEAR(found.interval.low, 0.2103448275862069, 1e-12);
  EXPECT_NEAR(found.interval.high, 0.66666666666666663, 1e-12);
  const results::MeanInterval other = results::cluster_bootstrap_mean(scenes, 999, 7);
  EXPECT_NEAR(other.interval.low, 0.21739130434782608, 1e-12);
  EXPECT_NEAR(other.interval.high, 0.68181818181818177, 1e-12);
}

TEST(Statistics, ReadingsOfThePapersTable) {
  // Rates of the paper with the number of episodes that it does not give; nobody got worse.
  struct Reading {
    int before, after, n;
    double low_before, high_before, low_after, high_after, p;
  };
  const Reading readings[] = {{1, 5, 5, .036, .625, .566, 1, .125},
                              {2, 10, 10, .057, .510, .722, 1, .0078},
                              {1, 2, 4, .046, .699, .150, .850, 1},
                              {2, 4, 8, .072, .591, .215, .785, .5},
                              {5, 10, 20, .112, .469, .299, .701, .0625}};
  for (const Reading& r : readings) {
    const results::Interval before = results::wilson_interval({r.before, r.n});
    const results::Interval after = results::wilson_interval({r.after, r.n});
    EXPECT_NEAR(before.low, r.low_before, 6e-4) << r.n;
    EXPECT_NEAR(before.high, r.high_before, 6e-4) << r.n;
    EXPECT_NEAR(after.low, r.low_after, 6e-4) << r.n;
    EXPECT_NEAR(after.high, r.high_after, 6e-4) << r.n;
    EXPECT_NEAR(results::mcnemar_exact_p(r.after - r.before, 0), r.p, 5e-5) << r.n;
  }
}

TEST(Statistics, VerdictWords) {
  EXPECT_EQ(results::verdict({5, 8, 0, 3}), "improved");
  EXPECT_EQ(results::verdict({5, 0, 8, 3}), "worse");
  EXPECT_EQ(results::verdict({2, 2, 1, 5}), "underpowered");
  EXPECT_EQ(results::verdict({20, 12, 5, 20}), "unresolved");
  EXPECT_EQ(results::verdict({200, 2, 2, 200}), "held");
}

}  // namespace
}  // namespace segsim::experiments
