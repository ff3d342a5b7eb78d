#pragma once

/// @file
/// Numbers as short texts.

#include <cstdint>
#include <cstdio>
#include <string>

namespace segsim::core {

/// printf into a string, cut at 255 characters.
template <class... Values>
[[nodiscard]] std::string print(const char* format, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

/// A hash as 16 hexadecimal digits.
[[nodiscard]] inline std::string hex(std::uint64_t value) {
  return print("%016llx", static_cast<unsigned long long>(value));
}

}  // namespace segsim::core
