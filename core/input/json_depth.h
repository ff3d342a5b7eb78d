#pragma once

/// @file
/// JSON libraries walk a document by recursion when they copy or print it: brackets without
/// end would overflow the stack.

#include <string_view>

namespace segsim::core {

/// Far beyond what any format here nests.
constexpr int kMostJsonLevels = 100;

/// Whether the brackets of a text are nested deeper than that.
[[nodiscard]] constexpr bool is_too_deep(std::string_view json) {
  int level = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < json.size(); ++i) {
    const char c = json[i];
    if (in_string) {
      if (c == '\\') ++i;
      in_string = c != '"';
    } else if (c == '"') {
      in_string = true;
    } else if (c == '[' || c == '{') {
      if (++level > kMostJsonLevels) return true;
    } else if (c == ']' || c == '}') {
      --level;
    }
  }
  return false;
}

}  // namespace segsim::core
