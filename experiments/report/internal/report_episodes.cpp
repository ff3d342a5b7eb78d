// Pages of a report about trials: the list of all, and one page per episode.
#include "core/formatted.h"
#include "experiments/report/internal/html.h"
#include "experiments/report/internal/report_model.h"
#include "sim/trial/goal_objects.h"

namespace segsim::experiments::report::internal {
namespace {

std::string trial_row(const TrialView& view) {
  const records::TrialRow& row = *view.row;
  const std::string fate = fate_of(row);
  std::string html = "<tr";
  const auto data = [&](const char* key, const std::string& value) {
    html += std::string(" data-") + key + "=\"" + html_escaped(value) + "\"";
  };
  data("scene", view.scene);
  data("arm", view.arm);
  data("training", row.arm);
  data("goal", row.goal_class);
  data("outcome", to_string(row.outcome));
  data("fate", fate);
  data("success", row.success ? "1" : "0");
  data("counts", row.counts() ? "1" : "0");
  data("change", view.change);
  html += "><td>" + html_link(view.page + "#" + view.anchor, std::to_string(row.trial_id)) +
          "</td>";
  const auto cell = [&](const std::string& text) {
    html += "<td>" + html_escaped(text) + "</td>";
  };
  cell(row.scene);
  html += "<td>" + html_link(view.page, row.episode) + "</td>";
  cell(row.goal_class);
  cell(row.arm);
  html += std::string("<td class=\"") + (row.success ? "success" : "failure") + "\">" +
          html_escaped(to_string(row.outcome)) + "</td>";
  cell(row.success ? "" : fate);
  cell(view.change);
  if (row.counts()) {
    cell(core::print("%.2f", row.spl));
    cell(core::print("%.1f", row.path_m));
    cell(core::print("%.1f", row.sim_s));
    cell(std::to_string(row.contacts));
  } else {
    html += "<td></td><td></td><td></td><td></td>";
  }
  return html + "</tr>\n";
}

std::string facts(const TrialView& view) {
  const records::TrialRow& row = *view.row;
  std::string html = "<dl>";
  const auto add = [&](const char* what, const std::string& value) {
    html += std::string("<dt>") + what + "</dt><dd>" + html_escaped(value) + "</dd>";
  };
  if (!row.success && row.why.known()) add("why", records::in_words(*row.why.cause));
  if (!row.error.empty()) add("error", row.error);
  if (row.counts()) {
    add("SPL", core::print("%.3f", row.spl));
    add("path", core::print("%.1f m (shortest %.1f m)", row.path_m, row.shortest_path_m));
    add("time", core::print("%.1f s, %d steps", row.sim_s, row.ticks));
    add("to goal", row.distance_to_goal_m
                       ? core::print("%.2f m at the end", *row.distance_to_goal_m)
                       : "off the floor at the end");
    add("stopped", row.stop_reason ? core::to_string(*row.stop_reason) : "no");
    if (row.contacts > 0) {
      add("contacts", core::print("%d, %.1f s", row.contacts, row.contact_s));
    }
    if (row.why.known()) {
      add("detector", core::print("in view in %d images, detected in %d, %d false detections",
                                  row.why.visible_frames, row.why.detected_frames,
                                  row.why.false_detections));
    }
  }
  return html + "</dl>\n";
}

/// One arm beside the others: outcome, picture from above, figures.
std::string column(const ReportModel& model, const TrialView& view) {
  const records::TrialRow& row = *view.row;
  std::string html =
      R"(<section class="card" id=")" + view.anchor +
      R"("><h2><span class="swatch" style="background:)" + arm_color(model, row.arm) +
      "\"></span>" + html_escaped(row.arm) +
      (row.repetition > 0 ? " (repetition " + std::to_string(row.repetition) + ")" : "") +
      "</h2>\n<p class=\"answer " + (row.success ? "success" : "failure") + "\">" +
      html_escaped(fate_of(row)) + "</p>\n";
  if (!view.picture.empty()) {
    html += R"(<a href="../)" + view.picture + R"("><img loading="lazy" src="../)" +
            view.picture + "\" alt=\"Path from above\"></a>\n";
  }
  if (!view.video.empty()) {
    html += R"(<video controls preload="none" src="../)" + view.video + "\"></video>\n";
  }
  return html + facts(view) + "</section>\n";
}

std::string story(const ReportModel& model, const TrialView& view) {
  if (view.strip.empty() && view.story.empty()) return {};
  std::string html = R"(<div class="box strip"><h3><span class="swatch" style="background:)" +
                     arm_color(model, view.row->arm) + "\"></span>" +
                     html_escaped(view.row->arm) + "</h3>\n";
  if (!view.strip.empty()) {
    html += R"(<img loading="lazy" src="../)" + view.strip +
            "\" alt=\"Camera, panoptic image and map at the key moments\">\n";
  }
  if (!view.story.empty()) {
    html += "<details><summary>Story of trial " + std::to_string(view.row->trial_id) +
            "</summary><pre>";
    for (const std::string& line : view.story) html += html_escaped(line) + "\n";
    html += "</pre></details>\n";
  }
  return html + "</div>\n";
}

}  // namespace

std::string trials_body(const ReportModel& model) {
  std::string html =
      "<header><h1>Trials</h1><p class=\"faint\">" + html_escaped(model.stored->run.title) +
      "</p></header>\n<nav><a href=\"index.html\">Report</a></nav>\n<div class=\"filters\">";
  for (const auto& [key, title] :
       {std::pair{"scene", "Scene"}, std::pair{"goal", "Goal"}, std::pair{"arm", "Arm"},
        std::pair{"training", "Training"}, std::pair{"outcome", "Outcome"},
        std::pair{"fate", "Cause"}, std::pair{"change", "Change"}}) {
    if (std::string(key) == "training" && model.table.trainings.size() < 2) continue;
    html += std::string("<label>") + title + "<select name=\"" + key +
            R"("><option value="">all</option></select></label>)";
  }
  html +=
      "<button type=\"button\" id=\"all\">Show all</button> <strong "
      "id=\"count\"></strong></div>\n"
      "<div class=\"scroll\"><table id=\"trials\"><thead><tr>";
  for (const char* title : {"Trial", "Scene", "Episode", "Goal", "Arm", "Outcome", "Cause",
                            "Change", "SPL", "Path [m]", "Time [s]", "Contacts"}) {
    html += std::string("<th scope=\"col\">") + title + "</th>";
  }
  html += "</tr></thead>\n<tbody>\n";
  for (const TrialView& view : model.trials) html += trial_row(view);
  return html + "</tbody></table></div>\n";
}

std::string episode_body(const ReportModel& model,
                         const std::vector<const TrialView*>& trials) {
  const records::TrialRow& first = *trials.front()->row;
  std::string change;
  for (const TrialView* view : trials) {
    if (!view->change.empty()) change = view->change;
  }
  std::string html = "<header><h1>Find " + html_escaped(sim::with_article(first.goal_class)) +
                     " <span class=\"faint\">" + html_escaped(first.episode) +
                     "</span></h1></header>\n<nav><a href=\"../index.html\">"
                     "Report</a><a href=\"" +
                     html_escaped(trials_href({{"scene", trials.front()->scene}}, "../")) +
                     "\">Trials of this scene</a>";
  if (!change.empty()) {
    html += "<a href=\"" + html_escaped(trials_href({{"change", change}}, "../")) +
            "\">Change: " + change + "</a>";
  }
  html += "</nav>\n<div class=\"pair\">\n";
  for (const TrialView* view : trials) html += column(model, *view);
  html += "</div>\n";
  std::string stories;
  for (const TrialView* view : trials) stories += story(model, *view);
  if (!stories.empty()) html += "<h2>What it saw and did</h2>\n" + stories;
  return html;
}

}  // namespace segsim::experiments::report::internal
