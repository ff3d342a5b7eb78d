#include "sim/sensors/pixel_noise.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim {
namespace {

/// Blocks of the generator that are made side by side; a block of four words serves four
/// pixels.
constexpr std::size_t kLanes = 32;
constexpr std::size_t kBlock_px = 4 * kLanes;

using Lane = std::array<std::uint32_t, kLanes>;
using Values = std::array<float, kLanes>;

/// The words of many blocks of Philox4x32-10 (core::philox4x32 for consecutive counters).
struct Words {
  Lane a, b, c, d;
  Words(std::uint32_t first_block, std::uint32_t layer,
        const std::array<std::uint32_t, 2>& capture, const std::array<std::uint32_t, 2>& key) {
    for (std::size_t k = 0; k < kLanes; ++k) {
      a[k] = first_block + static_cast<std::uint32_t>(k);
      b[k] = layer;
      c[k] = capture[0];
      d[k] = capture[1];
    }
    std::uint32_t key0 = key[0], key1 = key[1];
    for (int round = 0; round < 10; ++round) {
      for (std::size_t k = 0; k < kLanes; ++k) {
        const std::uint64_t p = std::uint64_t{0xD2511F53} * a[k];
        const std::uint64_t q = std::uint64_t{0xCD9E8D57} * c[k];
        a[k] = static_cast<std::uint32_t>(q >> 32) ^ b[k] ^ key0;
        b[k] = static_cast<std::uint32_t>(q);
        c[k] = static_cast<std::uint32_t>(p >> 32) ^ d[k] ^ key1;
        d[k] = static_cast<std::uint32_t>(p);
      }
      key0 += 0x9E3779B9;
      key1 += 0xBB67AE85;
    }
  }
};

/// Natural logarithm of a normal number in (0, 1], to 1e-6: x = m 2^e with m in
/// [sqrt(1/2), sqrt(2)), ln m = 2 artanh(s) with s = (m - 1) / (m + 1) as its series.
inline float log_of(float x) {
  // 0x3f3504f3: sqrt(1/2).
  const std::int32_t bits = std::bit_cast<std::int32_t>(x) - 0x3f3504f3;
  const auto exponent = static_cast<float>(bits >> 23);
  const float m = std::bit_cast<float>((bits & 0x007fffff) + 0x3f3504f3);
  const float s = (m - 1.0F) / (m + 1.0F);
  const float s2 = s * s;
  const float series =
      2.0F * s *
      (1.0F + s2 * (1.0F / 3.0F + s2 * (1.0F / 5.0F + s2 * (1.0F / 7.0F + s2 / 9.0F))));
  return series + exponent * 0.69314718F;
}

/// sin(2 pi t) for t in [-1/4, 1/4]: the Taylor series up to the 11th power (error < 6e-8).
inline float sine_of_turn(float t) {
  const float x = 6.2831853F * t;
  const float x2 = x * x;
  return x * (1.0F - x2 / 6.0F *
                         (1.0F - x2 / 20.0F *
                                     (1.0F - x2 / 42.0F *
                                                 (1.0F - x2 / 72.0F * (1.0F - x2 / 110.0F)))));
}

/// 24 bits, in [0, 1).
inline float unit(std::uint32_t word) {
  return static_cast<float>(static_cast<std::int32_t>(word >> 8)) * 0x1.0p-24F;
}

/// Box-Muller: two independent normal numbers from each pair of words.
void normal_pairs(const Lane& a, const Lane& b, Values& first, Values& second) {
  for (std::size_t k = 0; k < kLanes; ++k) {
    // In (0, 1]: the largest normal number is sqrt(2 ln 2^24) = 5.8.
    const float radius = std::sqrt(-2.0F * log_of(1.0F - unit(a[k])));
    // A turn in [-1/2, 1/2); sine and cosine by folding it to [-1/4, 1/4].
    const float turn = unit(b[k]) - 0.5F;
    const float folded = 0.25F - std::abs(std::abs(turn) - 0.25F);
    first[k] = radius * sine_of_turn(0.25F - std::abs(turn));
    second[k] = radius * sine_of_turn(std::copysign(folded, turn));
  }
}

void to_units(const Lane& words, Values& out) {
  for (std::size_t k = 0; k < kLanes; ++k) out[k] = unit(words[k]);
}

/// Hands out the numbers of consecutive pixels, four from each block.
/// @param make  Words -> the first, second, third and fourth pixel of every block.
template <class Make>
void fill(std::uint32_t first, std::span<float> values, const Make& make) {
  SEGSIM_CHECK(first % 4 == 0, "pixels come in fours");
  std::array<Values, 4> parts;
  std::array<float, kBlock_px> block;
  for (std::size_t done = 0; done < values.size(); done += kBlock_px) {
    make((first + static_cast<std::uint32_t>(done)) / 4, parts);
    for (std::size_t k = 0; k < kLanes; ++k) {
      for (std::size_t part = 0; part < 4; ++part) block[4 * k + part] = parts[part][k];
    }
    const std::size_t count = std::min(kBlock_px, values.size() - done);
    std::copy_n(block.begin(), count, values.begin() + static_cast<std::ptrdiff_t>(done));
  }
}

}  // namespace

PixelNoise::PixelNoise(std::uint64_t seed, std::string_view sensor, std::uint64_t capture) {
  const std::uint64_t key = core::hash64(sensor, seed);
  key_ = {static_cast<std::uint32_t>(key), static_cast<std::uint32_t>(key >> 32)};
  capture_ = {static_cast<std::uint32_t>(capture), static_cast<std::uint32_t>(capture >> 32)};
}

void PixelNoise::fill_normal(std::uint32_t layer, std::uint32_t first,
                             std::span<float> values) const {
  fill(first, values, [&](std::uint32_t block, std::array<Values, 4>& parts) {
    const Words words(block, layer, capture_, key_);
    normal_pairs(words.a, words.b, parts[0], parts[1]);
    normal_pairs(words.c, words.d, parts[2], parts[3]);
  });
}

void PixelNoise::fill_uniform(std::uint32_t layer, std::uint32_t first,
                              std::span<float> values) const {
  fill(first, values, [&](std::uint32_t block, std::array<Values, 4>& parts) {
    const Words words(block, layer, capture_, key_);
    to_units(words.a, parts[0]);
    to_units(words.b, parts[1]);
    to_units(words.c, parts[2]);
    to_units(words.d, parts[3]);
  });
}

}  // namespace segsim::sim
