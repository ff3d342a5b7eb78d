#include "experiments/support/text_grid.h"

#include <algorithm>
#include <cstdio>

#include "core/formatted.h"

namespace segsim::experiments::support {

std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

namespace internal {
namespace {

std::string line_of(const std::vector<std::string>& cells,
                    const std::vector<std::size_t>& widths) {
  std::string line;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    line += (i == 0 ? "" : "  ") + cells[i] + std::string(widths[i] - cells[i].size(), ' ');
  }
  return line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
}

std::string markdown_line(const std::vector<std::string>& cells) {
  std::string line = "|";
  for (const std::string& cell : cells) line += " " + cell + " |";
  return line + "\n";
}

}  // namespace

std::string text_of(const TextGrid& grid) {
  std::vector<std::size_t> widths;
  widths.reserve(grid.header.size());
  for (const std::string& cell : grid.header) widths.push_back(cell.size());
  for (const auto& row : grid.rows) {
    for (std::size_t i = 0; i < row.size(); ++i)
      widths[i] = std::max(widths[i], row[i].size());
  }
  std::vector<std::string> rules;
  rules.reserve(widths.size());
  for (const std::size_t width : widths) rules.emplace_back(width, '-');
  std::string text = line_of(grid.header, widths) + line_of(rules, widths);
  for (const auto& row : grid.rows) text += line_of(row, widths);
  return text;
}

std::string markdown_of(const TextGrid& grid) {
  std::string text = markdown_line(grid.header) + "|";
  for (std::size_t i = 0; i < grid.header.size(); ++i) text += "---|";
  text += "\n";
  for (const auto& row : grid.rows) text += markdown_line(row);
  return text;
}

std::string csv_of(const TextGrid& grid) {
  const auto line = [](const std::vector<std::string>& cells) {
    std::string text;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      text += (i == 0 ? "" : ",") + csv_cell(cells[i]);
    }
    return text + "\n";
  };
  std::string text = line(grid.header);
  for (const auto& row : grid.rows) text += line(row);
  return text;
}

std::string latex_escaped(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '\\':
        escaped += "\\textbackslash{}";
        break;
      case '~':
        escaped += "\\textasciitilde{}";
        break;
      case '^':
        escaped += "\\textasciicircum{}";
        break;
      case '<':
      case '>':
      case '|':
        escaped += std::string("$") + (c == '|' ? "\\vert" : std::string(1, c)) + "$";
        break;
      case '&':
      case '%':
      case '$':
      case '#':
      case '_':
      case '{':
      case '}':
        escaped += '\\';
        [[fallthrough]];
      default:
        escaped += c;
    }
  }
  return escaped;
}

std::string latex_of(const TextGrid& grid) {
  const auto line = [](const std::vector<std::string>& cells) {
    std::string text;
    for (const std::string& cell : cells) {
      text += (text.empty() ? "" : " & ") + latex_escaped(cell);
    }
    return text + " \\\\\n";
  };
  std::string text = "\\begin{tabular}{l" +
                     std::string(grid.header.empty() ? 0 : grid.header.size() - 1, 'c') +
                     "}\n\\toprule\n" + line(grid.header) + "\\midrule\n";
  for (const auto& row : grid.rows) text += line(row);
  return text + "\\bottomrule\n\\end{tabular}\n";
}

std::string amount(double value) {
  const auto digits = [](double v) {
    return v < 9.995 ? "%.2f" : v < 99.95 ? "%.1f" : "%.0f";
  };
  if (value < 999.5) return core::print("%.0f", value);
  if (value < 999.5e3) return core::print(digits(value / 1e3), value / 1e3) + " k";
  if (value < 999.5e6) return core::print(digits(value / 1e6), value / 1e6) + " M";
  return core::print(digits(value / 1e9), value / 1e9) + " G";
}

}  // namespace internal
}  // namespace segsim::experiments::support
