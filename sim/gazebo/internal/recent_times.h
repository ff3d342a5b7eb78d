#pragma once

#include <cstddef>
#include <vector>

#include "core/quantile.h"

namespace segsim::sim::internal {

/// The last times, for their median.
class RecentTimes {
 public:
  void add(double time_ms) {
    if (times_ms_.size() < kKept) {
      times_ms_.push_back(time_ms);
    } else {
      times_ms_[next_++ % kKept] = time_ms;
    }
  }
  [[nodiscard]] double quantile_ms(double share) const {
    if (times_ms_.empty()) return 0.0;
    return core::quantile(times_ms_, share, core::Between::kLower);
  }

 private:
  static constexpr std::size_t kKept = 4096;
  std::vector<double> times_ms_;
  std::size_t next_ = 0;
};

}  // namespace segsim::sim::internal
