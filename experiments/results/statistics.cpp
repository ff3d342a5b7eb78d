#include "experiments/results/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "core/check.h"
#include "core/random.h"

namespace segsim::experiments::results {
namespace {

void check_proportion(const Proportion& p) {
  SEGSIM_CHECK(p.trials >= 0 && p.successes >= 0 && p.successes <= p.trials,
               std::to_string(p.successes) + "/" + std::to_string(p.trials));
}

void check_probability(double probability) {
  SEGSIM_CHECK(probability > 0.0 && probability < 1.0, std::to_string(probability));
}

double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

/// Continued fraction of I_x(a, b); converges fast for x < (a + 1) / (a + b + 2).
double beta_continued_fraction(double a, double b, double x) {
  constexpr double kTiny = 1e-300;
  constexpr double kEpsilon = 1e-15;
  const auto away_from_zero = [](double v) { return std::abs(v) < kTiny ? kTiny : v; };
  double c = 1.0;
  double d = 1.0 / away_from_zero(1.0 - (a + b) * x / (a + 1.0));
  double result = d;
  for (int m = 1; m < 1000; ++m) {
    const double even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m));
    d = 1.0 / away_from_zero(1.0 + even * d);
    c = away_from_zero(1.0 + even / c);
    result *= d * c;
    const double odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0));
    d = 1.0 / away_from_zero(1.0 + odd * d);
    c = away_from_zero(1.0 + odd / c);
    result *= d * c;
    if (std::abs(d * c - 1.0) < kEpsilon) break;
  }
  return result;
}

/// C(n, k) / 2^n.
double binomial_half(int n, int k) {
  return std::exp(std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0) -
                  n * std::numbers::ln2);
}

/// P(X <= k) for X ~ Binomial(n, 1/2).
double binomial_half_cdf(int n, int k) {
  double sum = 0.0;
  for (int i = 0; i <= k; ++i) sum += binomial_half(n, i);
  return sum;
}

/// Where 2.5 % of the values lie below, and above (nearest rank).
Interval middle_95(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto tail = static_cast<std::size_t>(0.025 * static_cast<double>(values.size()));
  return {values[tail], values[values.size() - 1 - tail]};
}

}  // namespace

double normal_quantile(double probability) {
  check_probability(probability);
  // Acklam's rational approximation: central part for [0.02425, 0.97575], tails beyond.
  constexpr double kTail = 0.02425;
  double x = 0.0;
  if (probability < kTail || probability > 1.0 - kTail) {
    const double q = std::sqrt(-2.0 * std::log(std::min(probability, 1.0 - probability)));
    const double numerator =
        ((((-7.784894002430293e-03 * q - 3.223964580411365e-01) * q - 2.400758277161838e+00) *
              q -
          2.549732539343734e+00) *
             q +
         4.374664141464968e+00) *
            q +
        2.938163982698783e+00;
    const double denominator =
        (((7.784695709041462e-03 * q + 3.224671290700398e-01) * q + 2.445134137142996e+00) *
             q +
         3.754408661907416e+00) *
            q +
        1.0;
    x = (probability < kTail ? 1.0 : -1.0) * numerator / denominator;
  } else {
    const double q = probability - 0.5;
    const double r = q * q;
    const double numerator =
        (((((-3.969683028665376e+01 * r + 2.209460984245205e+02) * r - 2.759285104469687e+02) *
               r +
           1.383577518672690e+02) *
              r -
          3.066479806614716e+01) *
             r +
         2.506628277459239e+00) *
        q;
    const double denominator =
        ((((-5.447609879822406e+01 * r + 1.615858368580409e+02) * r - 1.556989798598866e+02) *
              r +
          6.680131188771972e+01) *
             r -
         1.328068155288572e+01) *
            r +
        1.0;
    x = numerator / denominator;
  }
  const double error = normal_cdf(x) - probability;
  const double step = error * std::sqrt(2.0 * std::numbers::pi) * std::exp(0.5 * x * x);
  return x - step / (1.0 + 0.5 * x * step);
}

double incomplete_beta(double a, double b, double x) {
  SEGSIM_CHECK(a > 0.0 && b > 0.0, std::to_string(a) + ", " + std::to_string(b));
  SEGSIM_CHECK(x >= 0.0 && x <= 1.0, std::to_string(x));
  if (x == 0.0 || x == 1.0) return x;
  const double log_front = std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) +
                           a * std::log(x) + b * std::log1p(-x);
  const double front = std::exp(log_front);
  if (x < (a + 1.0) / (a + b + 2.0)) return front * beta_continued_fraction(a, b, x) / a;
  return 1.0 - front * beta_continued_fraction(b, a, 1.0 - x) / b;
}

double inverse_incomplete_beta(double a, double b, double probability) {
  SEGSIM_CHECK(probability >= 0.0 && probability <= 1.0, std::to_string(probability));
  // I_x grows with x, so bisection always converges; 60 halvings give 1e-18.
  double low = 0.0, high = 1.0;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (incomplete_beta(a, b, middle) < probability ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

double student_two_sided_p(double t, double degrees_of_freedom) {
  SEGSIM_CHECK(degrees_of_freedom > 0.0, std::to_string(degrees_of_freedom));
  return incomplete_beta(0.5 * degrees_of_freedom, 0.5,
                         degrees_of_freedom / (degrees_of_freedom + t * t));
}

double student_quantile(double probability, double degrees_of_freedom) {
  check_probability(probability);
  SEGSIM_CHECK(degrees_of_freedom > 0.0, std::to_string(degrees_of_freedom));
  const double both_tails = 2.0 * std::min(probability, 1.0 - probability);
  const double x = inverse_incomplete_beta(0.5 * degrees_of_freedom, 0.5, both_tails);
  const double t = std::sqrt(degrees_of_freedom * (1.0 - x) / x);
  return probability < 0.5 ? -t : t;
}

Interval score_interval(double rate, double trials, double quantile) {
  SEGSIM_CHECK(rate >= 0.0 && rate <= 1.0 && trials > 0.0,
               std::to_string(rate) + " of " + std::to_string(trials));
  const double z = quantile, n = trials;
  const double centre = (rate + z * z / (2.0 * n)) / (1.0 + z * z / n);
  const double half =
      z / (1.0 + z * z / n) * std::sqrt(rate * (1.0 - rate) / n + z * z / (4.0 * n * n));
  // The ends are exact at 0 and 1; rounding must not push them past.
  return {rate == 0.0 ? 0.0 : std::max(0.0, centre - half),
          rate == 1.0 ? 1.0 : std::min(1.0, centre + half)};
}

Interval wilson_interval(const Proportion& p, double confidence) {
  check_proportion(p);
  check_probability(confidence);
  if (p.trials == 0) return {0.0, 1.0};
  return score_interval(p.value(), p.trials, normal_quantile(0.5 + 0.5 * confidence));
}

Interval clopper_pearson_interval(const Proportion& p, double confidence) {
  check_proportion(p);
  check_probability(confidence);
  const double tail = 0.5 * (1.0 - confidence);
  const double k = p.successes, n = p.trials;
  return {p.successes == 0 ? 0.0 : inverse_incomplete_beta(k, n - k + 1.0, tail),
          p.successes == p.trials ? 1.0 : inverse_incomplete_beta(k + 1.0, n - k, 1.0 - tail)};
}

double mcnemar_exact_p(int only_after, int only_before) {
  SEGSIM_CHECK(only_after >= 0 && only_before >= 0, "negative count");
  const int n = only_after + only_before;
  return std::min(1.0, 2.0 * binomial_half_cdf(n, std::min(only_after, only_before)));
}

double mcnemar_mid_p(int only_after, int only_before) {
  SEGSIM_CHECK(only_after >= 0 && only_before >= 0, "negative count");
  const int n = only_after + only_before;
  if (n == 0) return 1.0;
  const double observed = binomial_half(n, std::min(only_after, only_before));
  // An uneven split has a mirror image that is as uneven; the even one stands alone.
  const double as_uneven = only_after == only_before ? observed : 2.0 * observed;
  return mcnemar_exact_p(only_after, only_before) - 0.5 * as_uneven;
}

PairedDifference newcombe_paired_difference(const PairedCounts& counts, double confidence) {
  const double n = counts.total();
  if (counts.total() == 0) return {};
  const double a = counts.both, b = counts.only_after, c = counts.only_before,
               d = counts.neither;
  const Proportion after{counts.both + counts.only_after, counts.total()};
  const Proportion before{counts.both + counts.only_before, counts.total()};
  const Interval wilson_after = wilson_interval(after, confidence);
  const Interval wilson_before = wilson_interval(before, confidence);

  // Correlation of the two outcomes, phi, with Newcombe's continuity correction.
  const double product = (a + b) * (c + d) * (a + c) * (b + d);
  double phi = 0.0;
  if (product > 0.0) {
    const double covariance = a * d - b * c;
    const double corrected =
        covariance > 0.0 ? std::max(covariance - n / 2.0, 0.0) : covariance;
    phi = corrected / std::sqrt(product);
  }
  const double difference = after.value() - before.value();
  const auto half_width = [phi](double of_after, double of_before) {
    return std::sqrt(std::max(
        0.0, of_after * of_after - 2.0 * phi * of_after * of_before + of_before * of_before));
  };
  const double down =
      half_width(after.value() - wilson_after.low, wilson_before.high - before.value());
  const double up =
      half_width(wilson_after.high - after.value(), before.value() - wilson_before.low);
  return {difference, {difference - down, difference + up}};
}

int pairs_needed(double psi, double delta, double power) {
  SEGSIM_CHECK(psi > 0.0 && psi <= 1.0 && delta != 0.0 && std::abs(delta) <= psi,
               std::to_string(psi) + ", " + std::to_string(delta));
  check_probability(power);
  const double root = normal_quantile(0.975) * std::sqrt(psi) +
                      normal_quantile(power) * std::sqrt(psi - delta * delta);
  return static_cast<int>(std::ceil(root * root / (delta * delta)));
}

std::vector<double> holm_correction(std::span<const double> p_values) {
  std::vector<std::size_t> order(p_values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t i, std::size_t j) { return p_values[i] < p_values[j]; });
  std::vector<double> corrected(p_values.size());
  double largest = 0.0;
  for (std::size_t rank = 0; rank < order.size(); ++rank) {
    const double scaled = p_values[order[rank]] * static_cast<double>(order.size() - rank);
    largest = std::max(largest, std::min(1.0, scaled));
    corrected[order[rank]] = largest;
  }
  return corrected;
}

double sign_flip_p(std::span<const double> differences, int rounds, unsigned seed) {
  if (differences.empty()) return 1.0;
  const double observed =
      std::abs(std::accumulate(differences.begin(), differences.end(), 0.0));
  const double threshold = observed - 1e-12 * std::max(1.0, observed);
  constexpr std::size_t kExactUpTo = 16;
  if (differences.size() <= kExactUpTo) {
    const unsigned all = 1U << differences.size();
    unsigned as_extreme = 0;
    for (unsigned signs = 0; signs < all; ++signs) {
      double sum = 0.0;
      for (std::size_t i = 0; i < differences.size(); ++i) {
        sum += ((signs >> i) & 1U) != 0 ? -differences[i] : differences[i];
      }
      as_extreme += std::abs(sum) >= threshold ? 1U : 0U;
    }
    return static_cast<double>(as_extreme) / all;
  }
  if (differences.size() >= kNormalFrom) {
    // Flips are independent with mean 0, so the variance of their sum is that of squares.
    const double squares =
        std::inner_product(differences.begin(), differences.end(), differences.begin(), 0.0);
    return squares > 0.0 ? std::erfc(observed / std::sqrt(2.0 * squares)) : 1.0;
  }
  core::RandomStream random(seed, "sign_flip");
  int as_extreme = 1;  // The observed assignment is one of the possible ones.
  for (int round = 0; round < rounds; ++round) {
    double sum = 0.0;
    for (const double difference : differences) {
      sum += random.chance(0.5) ? -difference : difference;
    }
    as_extreme += std::abs(sum) >= threshold ? 1 : 0;
  }
  return static_cast<double>(as_extreme) / (rounds + 1);
}

MeanInterval bootstrap_mean(std::span<const double> values, int rounds, unsigned seed) {
  if (values.empty()) return {};
  const auto n = static_cast<double>(values.size());
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
  if (values.size() >= kNormalFrom) {
    double squares = 0.0;
    for (const double value : values) squares += (value - mean) * (value - mean);
    const double half = normal_quantile(0.975) * std::sqrt(squares) / n;
    return {mean, {mean - half, mean + half}};
  }
  core::RandomStream random(seed, "bootstrap");
  std::vector<double> means;
  for (int round = 0; round < rounds; ++round) {
    double sum = 0.0;
    for (std::size_t k = 0; k < values.size(); ++k) {
      sum += values[random.index(static_cast<std::uint32_t>(values.size()))];
    }
    means.push_back(sum / n);
  }
  return {mean, middle_95(std::move(means))};
}

MeanInterval cluster_bootstrap_mean(std::span<const ClusterSum> clusters, int rounds,
                                    unsigned seed) {
  std::vector<ClusterSum> used;
  ClusterSum all;
  for (const ClusterSum& cluster : clusters) {
    SEGSIM_CHECK(cluster.count >= 0, std::to_string(cluster.count));
    if (cluster.count == 0) continue;
    used.push_back(cluster);
    all.sum += cluster.sum;
    all.count += cluster.count;
  }
  if (used.empty()) return {};
  core::RandomStream random(seed, "cluster_bootstrap");
  std::vector<double> means;
  for (int round = 0; round < rounds; ++round) {
    ClusterSum drawn;
    for (std::size_t k = 0; k < used.size(); ++k) {
      const ClusterSum& cluster = used[random.index(static_cast<std::uint32_t>(used.size()))];
      drawn.sum += cluster.sum;
      drawn.count += cluster.count;
    }
    means.push_back(drawn.sum / drawn.count);
  }
  return {all.sum / all.count, middle_95(std::move(means))};
}

std::string verdict(const PairedCounts& counts, double p, const PairedDifference& difference) {
  constexpr double kSignificant = 0.05, kMargin = 0.1;
  constexpr int kFewPairs = 30;
  if (p < kSignificant) return difference.difference > 0.0 ? "improved" : "worse";
  const Interval& interval = difference.interval;
  if (counts.total() > 0 && interval.low > -kMargin && interval.high < kMargin) return "held";
  if (counts.discordant() < kMinDiscordantPairs && counts.total() < kFewPairs) {
    return "underpowered";
  }
  return "unresolved";
}

std::string verdict(const PairedCounts& counts) {
  return verdict(counts, mcnemar_exact_p(counts.only_after, counts.only_before),
                 newcombe_paired_difference(counts));
}

}  // namespace segsim::experiments::results
