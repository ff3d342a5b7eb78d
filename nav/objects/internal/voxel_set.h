#pragma once

/// @file
/// A set of 64-bit keys in one block of memory: a table with linear probing, in which what
/// follows an erased key moves up (Knuth 1973, algorithm R), so that nothing is left of it.

#include <cstdint>
#include <utility>
#include <vector>

namespace segsim::nav::internal {

class VoxelSet {
 public:
  /// Marks a free place. A key of this value is never kept: each insert() of it is the first.
  static constexpr std::uint64_t kFree = ~std::uint64_t{0};

  void clear() {
    slots_.assign(slots_.size(), kFree);
    size_ = 0;
  }
  [[nodiscard]] std::size_t size() const { return size_; }
  /// @return  Whether the key is new.
  bool insert(std::uint64_t key) {
    if (2 * (size_ + 1) > slots_.size()) grow();
    const std::size_t at = find(key);
    if (slots_[at] == key && key != kFree) return false;
    if (key == kFree) return true;
    slots_[at] = key;
    ++size_;
    return true;
  }
  void erase(std::uint64_t key) {
    if (size_ == 0 || key == kFree) return;
    std::size_t hole = find(key);
    if (slots_[hole] != key) return;
    // Whoever would not be found across the hole moves into it.
    for (std::size_t at = next(hole); slots_[at] != kFree; at = next(at)) {
      if (distance(home(slots_[at]), at) < distance(hole, at)) continue;
      slots_[hole] = slots_[at];
      hole = at;
    }
    slots_[hole] = kFree;
    --size_;
  }

 private:
  static constexpr std::size_t kFirstSlots = 1024;

  [[nodiscard]] std::size_t mask() const { return slots_.size() - 1; }
  [[nodiscard]] std::size_t next(std::size_t at) const { return (at + 1) & mask(); }
  [[nodiscard]] std::size_t distance(std::size_t from, std::size_t to) const {
    return (to - from) & mask();
  }
  [[nodiscard]] std::size_t home(std::uint64_t key) const {
    // Multiplicative hashing; the upper bits are the good ones.
    return static_cast<std::size_t>(key * 0x9E3779B97F4A7C15U >> 32) & mask();
  }
  /// Where the key is, or would be.
  [[nodiscard]] std::size_t find(std::uint64_t key) const {
    std::size_t at = home(key);
    while (slots_[at] != kFree && slots_[at] != key) at = next(at);
    return at;
  }
  void grow() {
    const std::vector<std::uint64_t> old = std::exchange(
        slots_,
        std::vector<std::uint64_t>(slots_.empty() ? kFirstSlots : 2 * slots_.size(), kFree));
    for (const std::uint64_t key : old) {
      if (key != kFree) slots_[find(key)] = key;
    }
  }

  std::vector<std::uint64_t> slots_;  // A power of two, at most half of them taken.
  std::size_t size_ = 0;
};

}  // namespace segsim::nav::internal
