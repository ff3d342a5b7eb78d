#pragma once

/// @file
/// From (tile, surfel) pairs in the order of tiles to pairs by surfel: sums over a surfel's
/// tiles are then always taken in the same order.

#include <cstdint>
#include <span>
#include <vector>

namespace segsim::reconstruction::internal {

/// A counting sort. Pairs are numbered in the order in which they are given.
class PairOrder {
 public:
  void begin(std::size_t surfel_count) { first_.assign(surfel_count + 1, 0); }
  /// First round: every pair once.
  void count(std::uint32_t surfel) { ++first_[surfel]; }
  void end_count() {
    // first_[s] becomes the end of s's range; place() walks it back to the start.
    std::uint32_t sum = 0;
    for (std::uint32_t& n : first_) n = sum += n;
    pairs_.resize(sum);
  }
  /// Second round: the same pairs in the opposite order.
  void place(std::uint32_t surfel, std::uint32_t pair) { pairs_[--first_[surfel]] = pair; }

  /// Pairs of a surfel, ascending.
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t surfel) const {
    return std::span(pairs_).subspan(first_[surfel], first_[surfel + 1] - first_[surfel]);
  }

 private:
  std::vector<std::uint32_t> first_, pairs_;
};

}  // namespace segsim::reconstruction::internal
