#include "experiments/report/suite_page.h"

#include <ostream>
#include <string>
#include <vector>

#include "core/file_io.h"
#include "experiments/report/internal/html.h"
#include "experiments/report/report_assets.h"
#include "experiments/results/generalisation_grids.h"
#include "experiments/results/table_grids.h"
#include "experiments/suites/episode_rows.h"
#include "experiments/suites/manifest.h"

namespace segsim::experiments::report {
namespace {

namespace fs = std::filesystem;
using internal::html_escaped;
using support::internal::Grid;

std::string header_html(const results::StoredRun& stored, const results::ResultTable& table) {
  const records::RunRow& run = stored.run;
  return "<header><h1>" + html_escaped(run.title) + "</h1><p class=\"faint\">Suite " +
         html_escaped(run.name) + ", segsim " + html_escaped(run.code_version) + ", " +
         std::to_string(table.finished_trials) + " of " + std::to_string(run.planned_trials) +
         " trials, started " + html_escaped(run.started) +
         "</p></header>\n<nav><a href=\"episodes.csv\">episodes.csv</a>"
         "<a href=\"episodes.jsonl\">episodes.jsonl</a>"
         "<a href=\"manifest.json\">manifest.json</a><a href=\"#scenes\">Scenes</a>"
         "<a href=\"#notes\">Notes</a><a href=\"#hashes\">Hashes</a></nav>\n";
}

std::string section(const std::string& id, const std::string& title, const Grid& grid) {
  if (grid.rows.empty()) return {};
  return "<h2 id=\"" + id + "\">" + html_escaped(title) + "</h2>\n" +
         internal::html_table(grid);
}

std::string notes_html(const results::ResultTable& table) {
  std::string html = "<h2 id=\"notes\">Notes</h2>\n<div class=\"box\"><ul>";
  for (const std::string& note : table.notes) html += "<li>" + html_escaped(note) + "</li>";
  return html + "</ul></div>\n";
}

Grid hashes_grid(const suites::Manifest& manifest) {
  Grid grid{"", {"What", "SHA-256"}, {}};
  for (const auto& [what, sha256] : manifest.hashes) grid.rows.push_back({what, sha256});
  grid.lines = {
      "Another machine that ran the same suite has these hashes, too: segsim suite verify "
      "compares them."};
  return grid;
}

std::string body_html(const results::StoredRun& stored, const suites::Manifest& manifest) {
  const results::ResultTable table = results::summarise(stored);
  Grid leaderboard = results::internal::leaderboard_grid(table);
  leaderboard.title.clear();
  Grid arms = results::internal::arms_grid(table, table.scenes);
  return header_html(stored, table) + section("leaderboard", "Leaderboard", leaderboard) +
         section("generalisation", "Does it carry over?",
                 results::internal::generalisation_grid(table)) +
         section("scenes", "Scenes", results::internal::mixed_grid(table)) +
         section("trials", "Trials", arms) + notes_html(table) +
         section("hashes", "Hashes", hashes_grid(manifest));
}

void write_text(const fs::path& file, const std::string& text) {
  core::write_file_atomically(file, [&](std::ostream& out) { out << text; });
}

}  // namespace

fs::path write_suite_page(const results::StoredRun& stored, const fs::path& output) {
  const suites::Manifest manifest = suites::manifest_of(stored);
  fs::create_directories(output);
  core::write_file_atomically(output / "episodes.csv", [&](std::ostream& out) {
    suites::write_episodes_csv(out, stored);
  });
  core::write_file_atomically(output / "episodes.jsonl", [&](std::ostream& out) {
    suites::write_episodes_jsonl(out, stored);
  });
  suites::write_manifest(output / "manifest.json", manifest);
  write_text(output / "report.css", internal::kReportCss);
  write_text(output / "report.js", internal::kReportJs);
  fs::path page = output / "index.html";
  write_text(page,
             internal::html_page(stored.run.title, body_html(stored, manifest), "", false));
  return page;
}

}  // namespace segsim::experiments::report
