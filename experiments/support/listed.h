#pragma once

/// @file
/// Names as one text.

#include <string>
#include <vector>

namespace segsim::experiments::support {

/// "chair, couch, tv"
[[nodiscard]] inline std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

}  // namespace segsim::experiments::support
