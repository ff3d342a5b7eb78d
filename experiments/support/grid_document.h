#pragma once

/// @file
/// Titled grids with notes below, as people read them: text, Markdown, LaTeX.

#include <cstdint>
#include <string>
#include <vector>

namespace segsim::experiments::support {

enum class TableFormat : std::uint8_t { kText, kMarkdown, kCsv, kJson, kLatex };

namespace internal {

/// A titled rectangle of cells.
struct Grid {
  std::string title;
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;
  std::vector<std::string> lines{};  ///< Sentences right below the cells.
};

struct GridDocument {
  std::string title;  ///< Empty: the first grid's title heads the document.
  std::vector<Grid> grids;
  std::vector<std::string> notes;
};

/// @param format  Text, Markdown or LaTeX; CSV and JSON have forms of their own.
[[nodiscard]] std::string document_text(const GridDocument& document, TableFormat format);

}  // namespace internal
}  // namespace segsim::experiments::support
