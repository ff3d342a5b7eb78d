#include "experiments/support/grid_document.h"

#include <algorithm>

#include "core/check.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::support::internal {
namespace {

TextGrid cells_of(const Grid& grid) { return {grid.header, grid.rows}; }

/// Breaks at spaces so that no line is longer than `width`, if it can be done.
std::string wrap(const std::string& text, std::size_t width, const std::string& indent) {
  std::string wrapped, line;
  std::size_t start = 0;
  while (start < text.size()) {
    const std::size_t end = std::min(text.find(' ', start), text.size());
    const std::string word = text.substr(start, end - start);
    if (!line.empty() && line.size() + 1 + word.size() > width) {
      wrapped.append(line).append("\n").append(indent);
      line.clear();
    }
    line += (line.empty() ? "" : " ") + word;
    start = end + 1;
  }
  return wrapped + line;
}

std::string as_text(const GridDocument& document) {
  std::string text = document.title.empty() ? "" : document.title + "\n\n";
  for (const Grid& grid : document.grids) {
    text += grid.title + "\n\n" + text_of(cells_of(grid));
    if (!grid.lines.empty()) text += "\n";
    for (const std::string& line : grid.lines) text += wrap(line, 100, "") + "\n";
    text += "\n";
  }
  for (const std::string& note : document.notes) text += "- " + wrap(note, 98, "  ") + "\n";
  return text;
}

std::string as_markdown(const GridDocument& document) {
  std::string text = document.title.empty() ? "" : "# " + document.title + "\n\n";
  for (const Grid& grid : document.grids) {
    TextGrid cells = cells_of(grid);
    for (std::vector<std::string>& row : cells.rows) {
      for (std::string& cell : row) {  // The asterisk of leakage is not emphasis.
        const std::size_t star = cell.rfind(" *");
        if (star != std::string::npos && star + 2 == cell.size()) cell.insert(star + 1, "\\");
      }
    }
    text += (text.empty() ? "# " : "## ") + grid.title + "\n\n" + markdown_of(cells) + "\n";
    for (const std::string& line : grid.lines) text += line + "\n\n";
  }
  for (const std::string& note : document.notes) text += "- " + note + "\n";
  return text;
}

std::string as_latex(const GridDocument& document) {
  std::string text = "% Needs \\usepackage{booktabs}.\n";
  if (!document.title.empty()) text += "% " + document.title + "\n";
  for (const Grid& grid : document.grids) {
    text += "\n\\begin{table}\n\\caption{" + latex_escaped(grid.title) + "}\n" +
            latex_of(cells_of(grid));
    for (const std::string& line : grid.lines) text += "\n" + latex_escaped(line) + "\n";
    text += "\\end{table}\n";
  }
  if (document.notes.empty()) return text;
  text += "\n\\begin{itemize}\n";
  for (const std::string& note : document.notes) {
    text += "\\item " + latex_escaped(note) + "\n";
  }
  return text + "\\end{itemize}\n";
}

}  // namespace

std::string document_text(const GridDocument& document, TableFormat format) {
  if (format == TableFormat::kMarkdown) return as_markdown(document);
  if (format == TableFormat::kLatex) return as_latex(document);
  SEGSIM_CHECK(format == TableFormat::kText, "CSV and JSON are not made of cells");
  return as_text(document);
}

}  // namespace segsim::experiments::support::internal
