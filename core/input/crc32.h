#pragma once

/// @file
/// The checksum of PNG chunks and of zip records.

#include <array>
#include <cstdint>
#include <string_view>

namespace segsim::core {

/// CRC-32 with the reflected polynomial 0xEDB88320 (PNG specification, annex D; PKZIP's
/// APPNOTE).
[[nodiscard]] inline std::uint32_t crc32(std::string_view bytes) {
  static constexpr std::array<std::uint32_t, 256> kTable = [] {
    std::array<std::uint32_t, 256> table{};
    for (std::uint32_t i = 0; i < 256; ++i) {
      std::uint32_t value = i;
      for (int bit = 0; bit < 8; ++bit) value = (value >> 1U) ^ ((value & 1U) * 0xEDB88320U);
      table[i] = value;
    }
    return table;
  }();
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const char byte : bytes) {
    crc = kTable[(crc ^ static_cast<std::uint8_t>(byte)) & 0xFFU] ^ (crc >> 8U);
  }
  return ~crc;
}

}  // namespace segsim::core
