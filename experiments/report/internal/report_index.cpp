// First page of a report: the answer, and what it rests on.
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "core/formatted.h"
#include "experiments/report/internal/html.h"
#include "experiments/report/internal/report_model.h"
#include "experiments/reproducibility/machine_record.h"
#include "experiments/results/insight_grids.h"
#include "experiments/results/table_grids.h"
#include "experiments/results/training_grids.h"

namespace segsim::experiments::report::internal {
namespace {

/// All scenes together, or the only one; null without any.
const results::GroupSummary* whole(const results::ResultTable& table) {
  if (table.all) return &*table.all;
  return table.scenes.empty() ? nullptr : &table.scenes.front();
}

/// "" stands for all scenes.
TrialFilter of_group(const ReportModel& model, const results::GroupSummary& group) {
  for (const records::SceneRow& scene : model.table.scene_rows) {
    if (scene.name == group.name) return {{"scene", group.name}};
  }
  return {};
}

TrialFilter with(TrialFilter filter, const std::string& key, const std::string& value) {
  filter.emplace_back(key, value);
  return filter;
}

/// "34/40" with a link to these trials.
std::string rate_link(const TrialFilter& group, const results::ArmSummary& arm) {
  const TrialFilter filter = with(with(group, "arm", arm.arm), "counts", "1");
  return html_link(trials_href(filter), std::to_string(arm.success.successes) + "/" +
                                            std::to_string(arm.success.trials));
}

std::string points(double share) { return core::print("%+.0f", 100.0 * share); }

std::string answer_words(const std::string& verdict) {
  if (verdict == "improved") return "Yes, it got better.";
  if (verdict == "worse") return "No, it got worse.";
  if (verdict == "held") return "No change of 10 points or more.";
  if (verdict == "underpowered") return "Too few episodes to tell.";
  return "Cannot tell: the difference may be chance.";
}

std::string better_card(const ReportModel& model) {
  const results::ResultTable& table = model.table;
  const results::GroupSummary* group = whole(table);
  std::string html = "<section class=\"card\"><h2>Did it get better?</h2>\n";
  if (group == nullptr) return html + "<p class=\"answer\">No trials yet.</p></section>\n";
  const TrialFilter filter = of_group(model, *group);
  if (!results::internal::compares(table)) {
    html += "<p class=\"answer\">Success rates of " + std::to_string(group->arms.size()) +
            (group->arms.size() == 1 ? " arm" : " arms") + "; no two are compared.</p>\n<dl>";
    for (const results::ArmSummary& arm : group->arms) {
      html += "<dt>" + html_escaped(arm.arm) + "</dt><dd>" + rate_link(filter, arm) +
              core::print(" = %.0f %%</dd>", 100.0 * arm.success.value());
    }
    return html + "</dl></section>\n";
  }
  html += "<p class=\"answer " + html_escaped(group->verdict) + "\">" +
          answer_words(group->verdict) + "</p>\n";
  const results::ArmSummary* before = group->find(table.before);
  const results::ArmSummary* after = group->find(table.after);
  if (before != nullptr && after != nullptr) {
    html += core::print("<p class=\"big\">%.0f %% &rarr; %.0f %%</p>\n",
                        100.0 * before->success.value(), 100.0 * after->success.value());
    html += "<p>" + html_escaped(table.before) + " " + rate_link(filter, *before) +
            " episodes succeed, " + html_escaped(table.after) + " " +
            rate_link(filter, *after) +
            (after->members > 1 ? " episodes x trainings.</p>\n" : ".</p>\n");
  }
  for (const std::string& line : results::internal::headline_lines(table)) {
    html += "<p class=\"faint\">" + html_escaped(line) + "</p>\n";
  }
  if (table.scenes.size() > 1) {
    html += "<ul>";
    for (const results::GroupSummary& scene : table.scenes) {
      html += "<li>" + html_escaped(scene.title) + ": " + points(scene.difference.difference) +
              " points, " +
              html_link(trials_href(with(of_group(model, scene), "change", "gained")),
                        std::to_string(scene.pairs.only_after) + " gained") +
              ", " +
              html_link(trials_href(with(of_group(model, scene), "change", "lost")),
                        std::to_string(scene.pairs.only_before) + " lost") +
              ", <span class=\"" + html_escaped(scene.verdict) + "\">" +
              html_escaped(scene.verdict) + "</span></li>";
    }
    html += "</ul>\n";
  }
  return html + "</section>\n";
}

/// Notes that a reader must not miss.
bool is_flag(const std::string& note) {
  for (const char* word :
       {"INTERIM", "ONE TRAINING", "LEAKAGE", "FLAGGED", "Fewer than", "No oracle"}) {
    if (note.starts_with(word)) return true;
  }
  return note.find("is below 0.95") != std::string::npos ||
         note.find("discordant pair") != std::string::npos;
}

std::string sure_card(const ReportModel& model) {
  const results::ResultTable& table = model.table;
  const results::GroupSummary* group = whole(table);
  std::string html = "<section class=\"card\"><h2>How sure are we?</h2>\n";
  if (group != nullptr && results::internal::compares(table) && group->pairs.total() > 0) {
    const TrialFilter filter = of_group(model, *group);
    const bool several = table.trainings.size() > 1;
    html += "<p class=\"answer\">p = " + results::internal::p_text(group->p) +
            "</p>\n<ul><li>" + html_escaped(results::internal::difference_text(*group)) +
            (several ? " points (95 % interval over trainings and episodes)</li><li>"
                     : " points (95 % interval, Newcombe, paired)</li><li>") +
            std::to_string(group->pairs.total()) +
            (several ? " episodes x trainings in both arms: " : " episodes in both arms: ") +
            html_link(trials_href(with(filter, "change", "gained")),
                      std::to_string(group->pairs.only_after) + " gained") +
            ", " +
            html_link(trials_href(with(filter, "change", "lost")),
                      std::to_string(group->pairs.only_before) + " lost") +
            (several ? "; test over " + results::internal::trainings_in_words(table)
                     : "; exact McNemar test") +
            "</li>";
    if (several) {
      html += "<li>standard deviation between trainings: " +
              core::print("%.0f points",
                          100.0 * results::internal::training_rate_sd(table.trainings)) +
              "</li>";
    } else if (table.compares_trainings) {
      html += "<li><strong>one training</strong>: another may give another result</li>";
    }
    const results::ArmSummary* oracle = group->find(table.oracle);
    if (oracle != nullptr && oracle->success.trials > 0) {
      html += "<li>a perfect detector reaches " + rate_link(filter, *oracle) + "</li>";
    }
    html += "</ul>\n";
  } else {
    html +=
        "<p>Intervals are in the plot below. To test two arms, name them with --before and "
        "--after.</p>\n";
  }
  html += "<ul class=\"flag\">";
  for (const std::string& note : table.notes) {
    if (is_flag(note)) html += "<li>" + html_escaped(note) + "</li>";
  }
  return html + "</ul></section>\n";
}

std::string why_card(const ReportModel& model) {
  std::string html = "<section class=\"card\"><h2>Why did it fail?</h2>\n";
  std::vector<std::string> arms;
  for (const std::string& arm : {model.table.after, model.table.before}) {
    if (!arm.empty()) arms.push_back(arm);
  }
  if (arms.empty()) {
    arms = arms_of(model);
  }
  for (const std::string& arm : arms) {
    std::map<std::string, int> fates;
    int failed = 0, trials = 0;
    for (const TrialView& view : model.trials) {
      if (view.arm != arm || !view.row->counts()) continue;
      ++trials;
      if (view.row->success) continue;
      ++failed;
      ++fates[fate_of(*view.row)];
    }
    std::vector<std::pair<std::string, int>> ordered(fates.begin(), fates.end());
    std::stable_sort(ordered.begin(), ordered.end(),
                     [](const auto& a, const auto& b) { return a.second > b.second; });
    html += "<h3>" + html_escaped(arm) + ": " +
            html_link(trials_href({{"arm", arm}, {"counts", "1"}, {"success", "0"}}),
                      std::to_string(failed) + " of " + std::to_string(trials) + " failed") +
            "</h3>\n<ul>";
    constexpr std::size_t kShown = 4;
    for (std::size_t k = 0; k < std::min(kShown, ordered.size()); ++k) {
      const auto& [fate, count] = ordered[k];
      html += "<li>" +
              html_link(trials_href({{"arm", arm}, {"counts", "1"}, {"fate", fate}}),
                        std::to_string(count) + " " + fate) +
              (fate_in_words(fate) == fate ? "" : ": " + html_escaped(fate_in_words(fate))) +
              "</li>";
    }
    if (ordered.size() > kShown) {
      html += "<li>" + std::to_string(ordered.size() - kShown) + " other causes</li>";
    }
    html += "</ul>\n";
  }
  return html + "</section>\n";
}

/// Rows of a grid whose first cell names a group and whose second names an arm.
std::string linked_by_arm(const ReportModel& model, const support::internal::Grid& grid) {
  std::map<std::string, TrialFilter> groups;
  std::set<std::string> twice;
  for (const results::GroupSummary& group : model.table.scenes) {
    if (!groups.emplace(group.title, of_group(model, group)).second) twice.insert(group.title);
  }
  return html_table(grid, [&](std::size_t row, std::size_t column) -> std::string {
    const std::vector<std::string>& cells = grid.rows[row];
    const auto found = groups.find(cells[0]);
    if (column < 2 || found == groups.end() || twice.contains(cells[0])) return {};
    TrialFilter filter = with(with(found->second, "arm", cells[1]), "counts", "1");
    if (grid.header[2] == "Failed") {
      filter = column == 2 ? with(filter, "success", "0")
                           : with(filter, "fate", grid.header[column]);
    }
    return trials_href(filter);
  });
}

/// @param key  What a group's name means to the list of trials: "scene" or "goal".
std::string linked_comparison(const ReportModel& model, const support::internal::Grid& grid,
                              const std::vector<results::GroupSummary>& groups,
                              const std::string& key) {
  const results::ResultTable& table = model.table;
  return html_table(grid, [&](std::size_t row, std::size_t column) -> std::string {
    const results::GroupSummary& group = groups[row];
    TrialFilter filter;
    if (key == "goal" || !of_group(model, group).empty()) filter = {{key, group.name}};
    if (column == 0) return {};
    if (!results::internal::compares(table)) {
      return trials_href(with(with(filter, "arm", group.arms[column - 1].arm), "counts", "1"));
    }
    if (column == 1)
      return trials_href(with(with(filter, "arm", table.before), "counts", "1"));
    if (column == 2) return trials_href(with(with(filter, "arm", table.after), "counts", "1"));
    if (column == 4) return trials_href(with(filter, "change", "gained"));
    if (grid.header[column] == "SR-Oracle") {
      return trials_href(with(with(filter, "arm", table.oracle), "counts", "1"));
    }
    return trials_href(filter);
  });
}

std::string tables_section(const ReportModel& model) {
  const results::ResultTable& table = model.table;
  std::vector<results::GroupSummary> groups = table.scenes;
  if (table.all) groups.push_back(*table.all);
  std::string html = "<h2 id=\"tables\">Tables</h2>\n";
  if (results::internal::compares(table)) {
    support::internal::Grid scenes =
        results::internal::comparison_grid(table, groups, "Scene", false);
    scenes.title = "Success rate by scene";
    html += linked_comparison(model, scenes, groups, "scene");
    const support::internal::Grid trainings = results::internal::trainings_grid(table);
    if (!trainings.rows.empty()) {
      html += html_table(trainings, [&](std::size_t row, std::size_t column) {
        if (column != 0) return std::string();
        return trials_href({{"training", table.trainings[row].arm}, {"counts", "1"}});
      });
    }
    html += linked_comparison(
        model, results::internal::comparison_grid(table, table.classes, "Goal", true),
        table.classes, "goal");
    html += html_table(results::internal::paired_grid(table, groups));
  } else {
    support::internal::Grid scenes = results::internal::rates_grid(table, groups, "Scene");
    scenes.title = "Success rate by scene";
    html += linked_comparison(model, scenes, groups, "scene");
    support::internal::Grid classes =
        results::internal::rates_grid(table, table.classes, "Goal");
    classes.title = "By goal class";
    html += linked_comparison(model, classes, table.classes, "goal");
  }
  for (const support::internal::Grid& grid :
       {results::internal::arms_grid(table, table.scenes),
        results::internal::causes_grid(table.scenes),
        results::internal::perception_grid(table.scenes),
        results::internal::profiles_grid(table.scenes)}) {
    if (!grid.rows.empty()) html += linked_by_arm(model, grid);
  }
  const support::internal::Grid detectors = results::internal::detectors_grid(table);
  if (!detectors.rows.empty()) html += html_table(detectors);
  return html;
}

std::string fate_color(const std::string& fate) {
  static const std::map<std::string, std::string> kColors{
      {"success", "#2e9e57"},
      {"false_positive", "#d62f2f"},
      {"bad_stop_true_positive", "#e07b1f"},
      {"timeout_true_positive", "#c9a400"},
      {"false_negative", "#8f3fb5"},
      {"detected_not_pursued", "#d0529b"},
      {"never_saw_target", "#2e6fd1"},
      {"no_frontier_left", "#13909e"},
      {"stuck", "#6b4b2a"}};
  const auto found = kColors.find(fate);
  return found == kColors.end() ? "#5c6670" : found->second;
}

std::string path_element(const TrialView& view) {
  const std::string fate = fate_of(*view.row);
  std::string line;
  for (const glm::dvec2& p : view.path_px) line += core::print("%.0f,%.0f ", p.x, p.y);
  const glm::dvec2 end = view.path_px.back();
  const std::string color = fate_color(fate);
  return "<a href=\"" + view.page + "#" + view.anchor + "\" data-arm=\"" +
         html_escaped(view.row->arm) + "\" data-cause=\"" + html_escaped(fate) + "\"><title>" +
         html_escaped(view.row->episode + ", " + view.row->arm + ": " + fate) +
         R"(</title><polyline class="path" stroke=")" + color + R"(" points=")" + line +
         "\"/>" +
         core::print("<circle cx=\"%.0f\" cy=\"%.0f\" r=\"6\" fill=\"%s\"/></a>\n", end.x,
                     end.y, color.c_str());
}

std::string map_section(const ReportModel& model, const SceneMap& map) {
  std::map<std::string, int> fates;
  std::string paths;
  for (const TrialView& view : model.trials) {
    if (view.row->scene != map.scene || view.path_px.empty()) continue;
    ++fates[fate_of(*view.row)];
    paths += path_element(view);
  }
  std::string html = "<div class=\"box maps\"><h3>" + html_escaped(map.title) +
                     "</h3>\n<div class=\"legend\"><label>Arm <select "
                     "aria-label=\"Arm\"><option value=\"\">all</option>";
  for (const records::ArmRow& arm : model.table.arm_rows) {
    html += "<option" + std::string(arm.name == model.table.after ? " selected" : "") + ">" +
            html_escaped(arm.name) + "</option>";
  }
  html += "</select></label>";
  for (const auto& [fate, count] : fates) {
    html += R"(<label><input type="checkbox" checked value=")" + html_escaped(fate) +
            R"("> <span class="swatch" style="background:)" + fate_color(fate) + "\"></span>" +
            html_escaped(fate) + " " + std::to_string(count) + "</label>";
  }
  return html + "</div>\n" +
         core::print(
             "<svg viewBox=\"0 0 %d %d\" role=\"img\" aria-label=\"Paths seen "
             "from above\"><image href=\"",
             map.width_px, map.height_px) +
         map.image +
         core::print("\" width=\"%d\" height=\"%d\" opacity=\"0.55\"/>\n", map.width_px,
                     map.height_px) +
         paths + "</svg></div>\n";
}

std::string notes_section(const ReportModel& model) {
  const records::RunRow& run = model.stored->run;
  std::string html = "<h2 id=\"notes\">Notes and provenance</h2>\n<div class=\"box\"><ul>";
  for (const std::string& note : model.table.notes)
    html += "<li>" + html_escaped(note) + "</li>";
  for (const std::string& note : model.notes) html += "<li>" + html_escaped(note) + "</li>";
  html += "</ul>\n<dl>";
  const auto add = [&](const char* what, const std::string& value) {
    if (!value.empty())
      html += std::string("<dt>") + what + "</dt><dd>" + html_escaped(value) + "</dd>";
  };
  add("success", run.success_profile);
  add("program", run.code_version + ", " + run.libraries);
  add("host", run.host);
  add("started", run.started);
  add("ended", run.ended);
  add("seed", std::to_string(run.seed));
  add("spec", run.spec_sha256);
  for (const auto& [name, value] : run.provenance) add(html_escaped(name).c_str(), value);
  for (const records::SceneRow& scene : model.table.scene_rows) {
    add("scene",
        scene.name + ": " + scene.scene_sha256 + ", episodes " + scene.episodes_sha256);
  }
  for (const records::ArmRow& arm : model.table.arm_rows) {
    add("arm",
        arm.name + ": " + arm.detector +
            (arm.weights_sha256.empty() ? "" : ", weights " + arm.weights_sha256) +
            (arm.tuned_on.empty() ? "" : ", tuned on " + arm.tuned_on) +
            (arm.exposure ? ", leakage: " + records::exposure_text(*arm.exposure) : ""));
  }
  return html + "</dl>\n<details><summary>Spec of the run</summary><pre>" +
         html_escaped(run.spec_text) +
         "</pre></details>\n<p><a href=\"table.json\">table.json</a> &middot; <a "
         "href=\"trials.csv\">trials.csv</a></p></div>\n";
}

/// What every stage made, for a comparison with another machine; nothing of an unfinished run.
std::string digests_section(const ReportModel& model) {
  if (!model.digests) return {};
  const reproducibility::MachineRecord& machine = model.digests->machine;
  std::string html =
      "<h2 id=\"digests\">Digests of the stages</h2>\n<div class=\"box\"><p>Another machine "
      "that "
      "computes the same bits has these digests, too: <code>segsim doctor --digests</code> "
      "compares two runs and names the first stage that differs. Computed on " +
      html_escaped(reproducibility::processor_in_words(machine)) + " with " +
      html_escaped(core::to_string(machine.kernels)) +
      " kernels.</p>\n<table><tr><th>stage</th><th>of</th><th>SHA-256</th></tr>\n";
  for (const reproducibility::StageDigest& digest : model.digests->stages) {
    html += std::string("<tr><td>") + reproducibility::to_string(digest.stage) + "</td><td>" +
            html_escaped(digest.subject) + "</td><td><code>" + html_escaped(digest.sha256) +
            "</code></td></tr>\n";
  }
  return html + "</table></div>\n";
}

/// A heading with the figures below, or nothing without figures.
std::string plots(const std::string& id, const std::string& title,
                  const std::string& figures) {
  if (figures.empty()) return {};
  return "<h2 id=\"" + id + "\">" + title + "</h2>\n<div class=\"plots\">\n" + figures +
         "</div>\n";
}

}  // namespace

std::string index_body(const ReportModel& model) {
  const records::RunRow& run = model.stored->run;
  const std::string delay = delay_figures(model), latency = latency_figures(model);
  std::string html = "<header><h1>" + html_escaped(run.title.empty() ? run.name : run.title) +
                     "</h1><p class=\"faint\">Run " + std::to_string(run.run_id) + " of " +
                     html_escaped(run.name) + ", " + html_escaped(run.started) + ", segsim " +
                     html_escaped(run.code_version) + "; " +
                     std::to_string(model.table.finished_trials) +
                     " trials</p></header>\n<nav><a href=\"trials.html\">All trials</a>" +
                     (model.maps.empty() ? "" : "<a href=\"#maps\">Maps</a>") +
                     "<a href=\"#tables\">Tables</a>" +
                     (latency.empty() ? "" : "<a href=\"#latency\">Latency</a>") +
                     (model.digests ? "<a href=\"#digests\">Digests</a>" : "") +
                     "<a href=\"#notes\">Notes</a></nav>\n<div class=\"cards\">\n" +
                     better_card(model) + sure_card(model) + why_card(model) + "</div>\n";
  html += plots("plots", "Success and failure",
                success_figure(model) + causes_figure(model) + steps_figure(model) + delay);
  if (!model.maps.empty()) html += "<h2 id=\"maps\">Paths, by what became of them</h2>\n";
  for (const SceneMap& map : model.maps) html += map_section(model, map);
  html += tables_section(model);
  html += plots("latency", "Latency", latency);
  return html + digests_section(model) + notes_section(model);
}

}  // namespace segsim::experiments::report::internal
