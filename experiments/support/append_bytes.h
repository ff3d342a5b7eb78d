#pragma once

/// @file
/// Numbers as bytes, for pages that read them as typed arrays.

#include <bit>
#include <cstring>
#include <string>
#include <type_traits>

namespace segsim::experiments::support {

/// Appends the bytes of a value, the lowest of a number first.
template <class Value>
void append_bytes(std::string& bytes, const Value& value) {
  static_assert(std::endian::native == std::endian::little);
  static_assert(std::is_trivially_copyable_v<Value>);
  const std::size_t at = bytes.size();
  bytes.resize(at + sizeof value);
  std::memcpy(bytes.data() + at, &value, sizeof value);
}

}  // namespace segsim::experiments::support
