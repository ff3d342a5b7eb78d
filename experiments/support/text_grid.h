#pragma once

/// @file
/// Cells in columns, for reports on the terminal, in Markdown and in LaTeX.

#include <string>
#include <vector>

namespace segsim::experiments::support {

/// A cell of CSV, in quotes if it must be (RFC 4180).
[[nodiscard]] std::string csv_cell(const std::string& text);

namespace internal {

struct TextGrid {
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;  ///< Each as long as the header.
};

/// Columns padded to their widest cell, with a rule below the header.
[[nodiscard]] std::string text_of(const TextGrid& grid);
[[nodiscard]] std::string markdown_of(const TextGrid& grid);

/// Of cells by csv_cell().
[[nodiscard]] std::string csv_of(const TextGrid& grid);
/// A tabular with the rules of booktabs; the first column to the left, others centred.
[[nodiscard]] std::string latex_of(const TextGrid& grid);
/// What LaTeX prints as this text.
[[nodiscard]] std::string latex_escaped(const std::string& text);

/// Three digits and a unit: "830", "12.3 k", "6.10 M".
[[nodiscard]] std::string amount(double value);

}  // namespace internal
}  // namespace segsim::experiments::support
