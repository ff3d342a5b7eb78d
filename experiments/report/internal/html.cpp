#include "experiments/report/internal/html.h"

#include "core/formatted.h"

namespace segsim::experiments::report::internal {
namespace {

bool is_plain(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
         c == '-' || c == '.' || c == '_';
}

}  // namespace

std::string html_escaped(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      case '\'':
        escaped += "&#39;";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

std::string url_escaped(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (is_plain(c) || c == '~') {
      escaped += c;
    } else {
      escaped += core::print("%%%02X", static_cast<unsigned>(static_cast<unsigned char>(c)));
    }
  }
  return escaped;
}

std::string script_json(const std::string& json) {
  std::string safe;
  for (const char c : json) safe += c == '<' ? std::string("\\u003c") : std::string(1, c);
  return safe;
}

std::string file_stem(const std::string& text) {
  std::string stem;
  for (const char c : text) stem += is_plain(c) ? c : '-';
  return stem.find_first_not_of('.') == std::string::npos ? "x" + stem : stem;
}

std::string html_link(const std::string& href, const std::string& text) {
  if (href.empty()) return html_escaped(text);
  return "<a href=\"" + html_escaped(href) + "\">" + html_escaped(text) + "</a>";
}

std::string trials_href(const TrialFilter& filter, const std::string& root) {
  std::string href = root + "trials.html";
  for (std::size_t i = 0; i < filter.size(); ++i) {
    href += (i == 0 ? "#" : "&") + filter[i].first + "=" + url_escaped(filter[i].second);
  }
  return href;
}

std::string html_table(const support::internal::Grid& grid,
                       const std::function<std::string(std::size_t, std::size_t)>& href) {
  std::string html = "<div class=\"scroll\"><table>\n";
  if (!grid.title.empty()) html += "<caption>" + html_escaped(grid.title) + "</caption>\n";
  html += "<thead><tr>";
  for (const std::string& cell : grid.header) {
    html += "<th scope=\"col\">" + html_escaped(cell) + "</th>";
  }
  html += "</tr></thead>\n<tbody>\n";
  for (std::size_t row = 0; row < grid.rows.size(); ++row) {
    html += "<tr>";
    for (std::size_t column = 0; column < grid.rows[row].size(); ++column) {
      const std::string& cell = grid.rows[row][column];
      const bool linked = href && cell != "-" && !cell.empty();
      html += "<td>" + html_link(linked ? href(row, column) : std::string(), cell) + "</td>";
    }
    html += "</tr>\n";
  }
  html += "</tbody></table></div>\n";
  for (const std::string& line : grid.lines) {
    html += "<p class=\"faint\">" + html_escaped(line) + "</p>\n";
  }
  return html;
}

std::string html_page(const std::string& title, const std::string& body,
                      const std::string& root, bool with_plots) {
  return "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
         "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
         "<link rel=\"icon\" href=\"data:,\">\n<title>" +
         html_escaped(title) + "</title>\n<link rel=\"stylesheet\" href=\"" + root +
         "report.css\">\n</head>\n<body>\n" + body +
         (with_plots ? "<script src=\"" + root + "chart.min.js\"></script>\n" : "") +
         "<script src=\"" + root + "report.js\"></script>\n</body>\n</html>\n";
}

}  // namespace segsim::experiments::report::internal
