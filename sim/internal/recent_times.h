#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

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
    std::vector<double> sorted = times_ms_;
    const auto at =
        static_cast<std::ptrdiff_t>(share * static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), sorted.begin() + at, sorted.end());
    return sorted[static_cast<std::size_t>(at)];
  }

 private:
  static constexpr std::size_t kKept = 4096;
  std::vector<double> times_ms_;
  std::size_t next_ = 0;
};

}  // namespace segsim::sim::internal
