#pragma once

#include <cstdio>
#include <string>

namespace segsim::reconstruction::internal {

/// One number in a format of printf.
template <class Number>
[[nodiscard]] std::string print(const char* format, Number value) {
  char text[160];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace segsim::reconstruction::internal
