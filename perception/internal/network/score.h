#pragma once

#include <cmath>
#include <limits>

namespace segsim::perception {

[[nodiscard]] inline float score_of_logit(float logit) {
  return 1.0F / (1.0F + std::exp(-logit));
}

/// A logit below which no score reaches the threshold, so that the many low ones need no
/// exponential. The margins are far above what rounding a score or a logit may change.
[[nodiscard]] inline float surely_low_logit(float score_threshold) {
  constexpr double kLogitMargin = 1e-3, kScoreMargin = 1e-6;
  const double t = double{score_threshold} - kScoreMargin;
  if (!(t > 0.0)) return -std::numeric_limits<float>::infinity();
  if (t >= 1.0) return std::numeric_limits<float>::infinity();
  return static_cast<float>(std::log(t / (1.0 - t)) - kLogitMargin);
}

}  // namespace segsim::perception
