#pragma once

/// @file
/// Cells in columns, for reports on the terminal and in Markdown.

#include <string>
#include <vector>

namespace segsim::experiments::internal {

struct TextGrid {
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;  ///< Each as long as the header.
};

/// Columns padded to their widest cell, with a rule below the header.
[[nodiscard]] std::string text_of(const TextGrid& grid);
[[nodiscard]] std::string markdown_of(const TextGrid& grid);

[[nodiscard]] std::string print(const char* format, double value);
/// Three digits and a unit: "830", "12.3 k", "6.10 M".
[[nodiscard]] std::string amount(double value);

}  // namespace segsim::experiments::internal
