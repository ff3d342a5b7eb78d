#pragma once

/// @file
/// Marked bytes among many that are not.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace segsim::nav::internal {

/// Calls `visit(index)` for every byte that has one of the bits. Few have: eight others are
/// passed at a time.
template <class Visit>
void for_each_set(const std::uint8_t* bytes, std::size_t count, std::uint8_t bits,
                  const Visit& visit) {
  const std::uint64_t bits_of_eight = 0x0101010101010101U * bits;
  for (std::size_t x = 0; x < count; x += 8) {
    const std::size_t end = std::min(x + 8, count);
    if (end == x + 8) {
      std::uint64_t eight = 0;
      std::memcpy(&eight, bytes + x, sizeof(eight));
      if ((eight & bits_of_eight) == 0) continue;
    }
    for (std::size_t k = x; k < end; ++k) {
      if ((bytes[k] & bits) != 0) visit(k);
    }
  }
}

}  // namespace segsim::nav::internal
