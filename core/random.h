#pragma once

/// @file
/// Counter-based random numbers (Philox4x32-10, Salmon et al. 2011, "Parallel random numbers:
/// as easy as 1, 2, 3"). A stream is named by its keys and needs no hidden state, so adding a
/// draw in one place never shifts the numbers of another.

#include <array>
#include <cstdint>
#include <string_view>

namespace segsim::core {

/// The Philox4x32-10 block function.
[[nodiscard]] std::array<std::uint32_t, 4> philox4x32(std::array<std::uint32_t, 4> counter,
                                                      std::array<std::uint32_t, 2> key);

/// 64-bit FNV-1a.
[[nodiscard]] std::uint64_t hash64(std::string_view text, std::uint64_t seed = 0);

/// A stream of random numbers. Equal (seed, name, index) give equal sequences on every
/// machine.
class RandomStream {
 public:
  /// @param seed  Seed of the run.
  /// @param name  What the numbers are for, for example "depth_noise".
  /// @param index  Which instance of it, for example the capture number.
  RandomStream(std::uint64_t seed, std::string_view name, std::uint64_t index = 0);

  std::uint32_t next_u32();
  /// Uniform in [0, 1).
  double uniform();
  double uniform(double lo, double hi) { return lo + (hi - lo) * uniform(); }
  /// Uniform in {0, ..., count - 1}; count > 0.
  std::uint32_t index(std::uint32_t count);
  /// Standard normal (Box-Muller).
  double normal();
  bool chance(double probability) { return uniform() < probability; }

 private:
  std::array<std::uint32_t, 2> key_;
  std::array<std::uint32_t, 4> counter_;
  std::array<std::uint32_t, 4> block_{};
  int used_ = 4;
};

}  // namespace segsim::core
