#pragma once

/// @file
/// Hashes and checksums made right again, so that damage gets past them.

#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>

#include "core/file_io.h"
#include "core/input/crc32.h"

namespace segsim::fuzz {

inline void put_big_endian(std::string& bytes, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) {
    bytes[at + i] = static_cast<char>((value >> (24U - 8U * i)) & 0xFFU);
  }
}

[[nodiscard]] inline std::uint32_t get_big_endian(std::string_view bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value = (value << 8U) | static_cast<unsigned char>(bytes[at + i]);
  }
  return value;
}

/// The checksums of a PNG's chunks, as far as they go.
[[nodiscard]] inline std::string with_png_checksums(std::string bytes) {
  for (std::size_t at = 8; bytes.size() >= at + 12;) {
    const std::size_t length = get_big_endian(bytes, at);
    if (bytes.size() - at - 12 < length) break;
    put_big_endian(bytes, at + 8 + length,
                   core::crc32(std::string_view(bytes).substr(at + 4, length + 4)));
    at += length + 12;
  }
  return bytes;
}

/// Size and hash of the layout of renderer/files/internal/checked_file.h.
[[nodiscard]] inline std::string with_checked_payload(std::string bytes) {
  constexpr std::size_t kSize = 12, kHash = 20, kPayload = 84;
  if (bytes.size() < kPayload) return bytes;
  const std::uint64_t size = bytes.size() - kPayload;
  std::memcpy(bytes.data() + kSize, &size, sizeof size);
  const std::string hash = core::sha256_hex(bytes.substr(kPayload));
  return bytes.replace(kHash, hash.size(), hash);
}

}  // namespace segsim::fuzz
