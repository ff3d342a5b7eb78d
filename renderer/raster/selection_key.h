#pragma once

/// @file
/// Weight and list position in one word: what the blend loop keeps of a selected surfel.

#include <bit>
#include <cstdint>

namespace segsim::renderer::internal {

/// Larger keys are heavier; of equal weights the nearer is. Positive keys sort as floats, too.
///
///     bits 30 ... 12   weight: a float's last 5 bits of exponent, 14 bits of fraction
///
///     bits 11 ...  0   complement of the list position
///
/// Weights lie in (2^-31, 1), where bits 29 and 28 of a float are set and 30 is not. A key
/// without weight is no key, whatever its position.
inline constexpr std::uint32_t kKeyPositionMask = 0xFFF;
inline constexpr std::uint32_t kKeyWeightMask = 0x7FFFF000;
inline constexpr int kKeyShift = 3;
inline constexpr std::uint32_t kKeyExponent = 0x30000000;
/// Half of the first bit that a key drops: with it weights are right to 3.1e-5 of their value.
inline constexpr std::uint32_t kKeyHalf = (kKeyPositionMask + 1) >> (kKeyShift + 1);
/// List positions that one set of keys can tell apart. Longer lists are taken in windows.
inline constexpr std::uint32_t kWindow = kKeyPositionMask + 1;

[[nodiscard]] constexpr bool is_key(std::uint32_t key) { return key > kKeyPositionMask; }

/// @param key  With weight.
[[nodiscard]] constexpr float key_weight(std::uint32_t key) {
  return std::bit_cast<float>((key & kKeyWeightMask) >> kKeyShift | kKeyExponent | kKeyHalf);
}

[[nodiscard]] constexpr std::uint32_t key_position(std::uint32_t key) {
  return ~key & kKeyPositionMask;
}

}  // namespace segsim::renderer::internal
