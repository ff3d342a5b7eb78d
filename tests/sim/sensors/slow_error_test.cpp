#include "sim/sensors/slow_error.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "core/check.h"

namespace segsim::sim {
namespace {

constexpr core::TimeNs kStep_ns = 20'000'000;

TEST(SlowError, WhiteNoiseHasItsSigma) {
  SlowError error({0.5, 0.0, 10.0}, 1, "x");
  double sum = 0.0, squares = 0.0, neighbours = 0.0, last = 0.0;
  constexpr int kReadings = 20000;
  for (int k = 0; k < kReadings; ++k) {
    const double e = error.next(k * kStep_ns);
    sum += e;
    squares += e * e;
    neighbours += e * last;
    last = e;
  }
  EXPECT_NEAR(sum / kReadings, 0.0, 4.0 * 0.5 / std::sqrt(kReadings));
  EXPECT_NEAR(squares / kReadings, 0.25, 4.0 * 0.25 * std::sqrt(2.0 / kReadings));
  EXPECT_NEAR(neighbours / kReadings, 0.0, 4.0 * 0.25 / std::sqrt(kReadings));
}

/// Mean square of the bias at several times, and its product with its beginning, over
/// episodes.
struct Spread {
  double at_start = 0.0, at_end = 0.0, product = 0.0;
};
Spread drift_spread(double end_s, int steps) {
  Spread spread;
  constexpr int kEpisodes = 4000;
  for (std::uint64_t seed = 0; seed < kEpisodes; ++seed) {
    SlowError error({0.0, 2.0, 30.0}, seed, "x");
    const double first = error.next(0);
    double last = first;
    for (int k = 1; k <= steps; ++k) {
      last = error.next(static_cast<core::TimeNs>(end_s * 1e9 * k / steps));
    }
    spread.at_start += first * first / kEpisodes;
    spread.at_end += last * last / kEpisodes;
    spread.product += first * last / kEpisodes;
  }
  return spread;
}

TEST(SlowError, DriftKeepsItsSpreadAndForgets) {
  // The standard error of a variance of 4000 episodes is 2.2 %.
  for (const int steps : {1, 50}) {
    const Spread spread = drift_spread(30.0, steps);
    EXPECT_NEAR(spread.at_start, 4.0, 0.4);
    EXPECT_NEAR(spread.at_end, 4.0, 0.4) << steps << ": whatever the rate";
    EXPECT_NEAR(spread.product, 4.0 * std::exp(-1.0), 0.3) << steps;
  }
}

TEST(SlowError, KeysAreSeedNameAndReading) {
  const auto first = [](std::uint64_t seed, const char* name) {
    return SlowError({1.0, 1.0, 10.0}, seed, name).next(0);
  };
  EXPECT_EQ(first(1, "a"), first(1, "a"));
  EXPECT_NE(first(1, "a"), first(2, "a"));
  EXPECT_NE(first(1, "a"), first(1, "b"));
  SlowError none({}, 1, "a");
  EXPECT_EQ(none.next(0), 0.0);
  EXPECT_EQ(none.next(kStep_ns), 0.0);
}

TEST(SlowError, RefusesWhatIsNoModel) {
  EXPECT_THROW(SlowError({-1.0, 0.0, 1.0}, 1, "a"), core::ContractViolation);
  EXPECT_THROW(SlowError({1.0, 0.0, 0.0}, 1, "a"), core::ContractViolation);
  SlowError error({1.0, 1.0, 1.0}, 1, "a");
  (void)error.next(100);
  EXPECT_THROW((void)error.next(99), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::sim
