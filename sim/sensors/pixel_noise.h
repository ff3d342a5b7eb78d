#pragma once

/// @file
/// Random numbers for every pixel of an image: counter-based (Philox4x32-10, core/random.h),
/// in loops that a compiler can vectorise, and with the same bits on every machine (additions,
/// multiplications and square roots only; no function of the C library).
///
/// The numbers of a pixel depend on seed, sensor name, capture index, layer and the pixel's
/// place alone: neither on the arm, nor on the other pixels, nor on other captures.

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

namespace segsim::sim {

class PixelNoise {
 public:
  /// @param seed  Of the episode. @param sensor  Its name, for example "camera/rgb".
  /// @param capture  Which of its images.
  PixelNoise(std::uint64_t seed, std::string_view sensor, std::uint64_t capture);

  /// `values[k]` = the standard normal number of pixel `first + k` in that layer. Layers are
  /// independent images of noise. @param first  A multiple of 4.
  void fill_normal(std::uint32_t layer, std::uint32_t first, std::span<float> values) const;
  /// The same, uniform in [0, 1).
  void fill_uniform(std::uint32_t layer, std::uint32_t first, std::span<float> values) const;

 private:
  std::array<std::uint32_t, 2> key_;
  std::array<std::uint32_t, 2> capture_;
};

}  // namespace segsim::sim
