#pragma once

/// @file
/// Statistics of success rates. All functions are pure and exact to about 1e-9.
///
/// Symbols: k successes of n trials, p = k/n. Paired outcomes of two arms on the same
/// episodes:
///   a  both succeed          b  only the second ("after") succeeds
///   c  only the first does   d  both fail

#include <span>
#include <string>
#include <vector>

namespace segsim::experiments::results {

struct Interval {
  double low = 0.0, high = 1.0;
};

/// Successes out of trials; 0 <= successes <= trials.
struct Proportion {
  int successes = 0, trials = 0;
  /// 0 for no trials.
  [[nodiscard]] double value() const {
    return trials == 0 ? 0.0 : static_cast<double>(successes) / trials;
  }
};

/// Outcomes of two arms on the same episodes.
struct PairedCounts {
  int both = 0, only_after = 0, only_before = 0, neither = 0;
  [[nodiscard]] int total() const { return both + only_after + only_before + neither; }
  [[nodiscard]] int discordant() const { return only_after + only_before; }
};

/// Inverse of the standard normal distribution function, 0 < probability < 1 (Acklam's
/// rational approximation and one Halley step).
[[nodiscard]] double normal_quantile(double probability);

/// Regularised incomplete beta function I_x(a, b) for a, b > 0 and x in [0, 1] (continued
/// fraction by Lentz's method).
[[nodiscard]] double incomplete_beta(double a, double b, double x);
/// x with I_x(a, b) = probability.
[[nodiscard]] double inverse_incomplete_beta(double a, double b, double probability);

/// Two-sided p-value of Student's t, degrees_of_freedom > 0.
[[nodiscard]] double student_two_sided_p(double t, double degrees_of_freedom);
/// Inverse of Student's distribution function, 0 < probability < 1.
[[nodiscard]] double student_quantile(double probability, double degrees_of_freedom);

/// Wilson's score interval (1927): for display. [0, 1] for no trials.
[[nodiscard]] Interval wilson_interval(const Proportion& p, double confidence = 0.95);

/// Wilson's interval of a rate in [0, 1] that is worth `trials` > 0 independent trials, not
/// necessarily a whole number, at `quantile` standard errors.
[[nodiscard]] Interval score_interval(double rate, double trials, double quantile);

/// Clopper and Pearson's interval (1934): covers at least `confidence` always.
[[nodiscard]] Interval clopper_pearson_interval(const Proportion& p, double confidence = 0.95);

/// Exact two-sided McNemar test: min(1, 2 sum_{i <= min(b,c)} C(b+c, i) / 2^(b+c)); 1 if b + c
/// = 0.
[[nodiscard]] double mcnemar_exact_p(int only_after, int only_before);

/// The same with half the probability of splits as uneven as the observed one (mid-p;
/// Fagerland, Lydersen & Laake 2013): P(|X - n/2| > |b - n/2|) + P(|X - n/2| = |b - n/2|) / 2
/// for X ~ Binomial(n = b + c, 1/2). Less conservative. 1 if b + c = 0, where nothing is
/// observed.
[[nodiscard]] double mcnemar_mid_p(int only_after, int only_before);

/// Fewer discordant pairs than this cannot give p < 0.05 in the exact test, whatever their
/// split.
inline constexpr int kMinDiscordantPairs = 6;

/// after - before with Newcombe's paired score interval (1998, method 10). It may disagree
/// with the exact test at small n; the test decides.
struct PairedDifference {
  double difference = 0.0;
  Interval interval{-1.0, 1.0};
};
[[nodiscard]] PairedDifference newcombe_paired_difference(const PairedCounts& counts,
                                                          double confidence = 0.95);

/// Pairs needed at the 5 % level, two-sided (Connor 1987): psi = share of discordant pairs,
/// delta = difference of the success rates, 0 < |delta| <= psi <= 1. @param power  Of finding
/// that difference, in (0, 1).
[[nodiscard]] int pairs_needed(double psi, double delta, double power = 0.8);

/// p-values after Holm's correction (1979) for their number, in the order given.
[[nodiscard]] std::vector<double> holm_correction(std::span<const double> p_values);

/// From so many values on, sums of random draws are taken for normal: sign_flip_p() and
/// bootstrap_interval() then draw nothing, so that a table of 100 000 trials does not wait for
/// 10 000 rounds of each.
inline constexpr std::size_t kNormalFrom = 1000;

/// Two-sided sign-flip permutation test of mean(difference) = 0. Exact for up to 16 values,
/// `rounds` random flips drawn from `seed` for fewer than kNormalFrom, beyond that the normal
/// limit of the flips. 1 for no values.
[[nodiscard]] double sign_flip_p(std::span<const double> differences, int rounds = 10000,
                                 unsigned seed = 1);

/// A mean with an interval of 95 %.
struct MeanInterval {
  double mean = 0.0;
  Interval interval{0.0, 0.0};
};

/// Percentile bootstrap of the mean (Efron 1979): `rounds` samples with replacement, drawn
/// from `seed`; from kNormalFrom values on its normal limit. Too narrow for a handful of
/// values. The mean alone, twice, for one value; zeros for none.
[[nodiscard]] MeanInterval bootstrap_mean(std::span<const double> values, int rounds = 10000,
                                          unsigned seed = 1);

/// One cluster of a cluster bootstrap: the values of one scene, as their sum and number.
struct ClusterSum {
  double sum = 0.0;
  int count = 0;
};

/// With fewer scenes nothing can be said about others.
inline constexpr std::size_t kScenesForClaim = 5;

/// Mean over all values, with an interval from drawing whole clusters with replacement: what
/// differs between scenes counts, not only what differs between the episodes of a scene. Says
/// little for fewer than kScenesForClaim clusters. Empty clusters are left out.
[[nodiscard]] MeanInterval cluster_bootstrap_mean(std::span<const ClusterSum> clusters,
                                                  int rounds = 10000, unsigned seed = 1);

/// In one word: "improved", "worse" (p < 0.05), "underpowered" (fewer than kMinDiscordantPairs
/// discordant pairs and fewer than 30 pairs), "held" (the interval of the difference lies
/// within +-0.1), "unresolved".
/// @param p, difference  Of the test and the interval that suit the design.
[[nodiscard]] std::string verdict(const PairedCounts& counts, double p,
                                  const PairedDifference& difference);
/// The same by McNemar's exact test and Newcombe's interval: of one training.
[[nodiscard]] std::string verdict(const PairedCounts& counts);

}  // namespace segsim::experiments::results
