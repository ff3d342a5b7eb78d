// A scripted trial's result as text and as JSON.
#include <cmath>

#include <nlohmann/json.hpp>

#include "core/formatted.h"
#include "core/version.h"
#include "experiments/results/timing_report.h"
#include "experiments/scripted_trials/internal/script_metrics.h"
#include "experiments/scripted_trials/scripted_run.h"

namespace segsim::experiments::scripted_trials {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }
Json number(const std::optional<double>& value) {
  return value ? number(*value) : Json(nullptr);
}

std::string bounds(const Expectation& wanted) {
  std::string text;
  if (wanted.min) text += core::print(" >= %g", *wanted.min);
  if (wanted.min && wanted.max) text += " and";
  if (wanted.max) text += core::print(" <= %g", *wanted.max);
  return text;
}

std::string name_of(const Expectation& wanted) {
  return wanted.metric + (wanted.stage.empty() ? "" : " of " + wanted.stage);
}

Json steps_json(const ScriptedTrial& script, const ScriptedResult& result) {
  Json steps = Json::array();
  for (std::size_t k = 0; k < script.steps.size(); ++k) {
    Json json{{"kind", to_string(script.steps[k].kind)}};
    if (k < result.steps.size()) {
      const StepOutcome& step = result.steps[k];
      json["begin_s"] = core::seconds(step.begin_ns);
      json["end_s"] = step.end ? Json(core::seconds(step.end_ns)) : Json(nullptr);
      json["end"] = step.end ? to_string(*step.end) : "not_finished";
      if (const std::string why = reason_of(step); !why.empty()) json["reason"] = why;
    } else {
      json["end"] = "not_begun";
    }
    for (const FindResult& find : result.finds) {
      if (find.step != static_cast<int>(k)) continue;
      json["find"] = {{"success", find.success},
                      {"view_point_m", number(find.view_point_m)},
                      {"visible_px", find.visible_px},
                      {"path_m", find.path_m},
                      {"shortest_path_m", number(find.shortest_path_m)},
                      {"spl", number(find.spl)}};
    }
    steps.push_back(std::move(json));
  }
  return steps;
}

Json contacts_json(const sim::TrialResult& trial) {
  Json contacts = Json::array();
  for (const sim::ContactRecord& contact : trial.contact_log) {
    contacts.push_back({{"time_s", core::seconds(contact.time_ns)},
                        {"point_m", {contact.point_m.x, contact.point_m.y}},
                        {"normal", {contact.normal.x, contact.normal.y}},
                        {"approach_mps", contact.approach_mps},
                        {"duration_s", contact.duration_s},
                        {"instance", contact.instance}});
  }
  return contacts;
}

}  // namespace

std::string in_words(const ScriptedTrial& script, const ScriptedResult& result) {
  const sim::TrialResult& trial = result.trial;
  std::string text;
  for (const StepOutcome& step : result.steps) {
    const auto k = static_cast<std::size_t>(step.step);
    text += core::print("step %zu  %-6s  %7.2f s .. ", k + 1, to_string(script.steps[k].kind),
                        core::seconds(step.begin_ns));
    text += step.end ? core::print("%7.2f s  %s\n", core::seconds(step.end_ns),
                                   to_string(*step.end))
                     : std::string("          not finished\n");
  }
  for (const FindResult& find : result.finds) {
    text += core::print(
        "find of step %d: %s, %.2f m from a view point, %d px in view, path %.2f m "
        "(shortest %.2f m)\n",
        find.step + 1, find.success ? "success" : "no success", find.view_point_m,
        find.visible_px, find.path_m, find.shortest_path_m);
  }
  text += core::print("%.2f s of simulated time, path %.2f m, %d contact%s (%.2f s)\n",
                      trial.sim_s, trial.path_m, trial.contacts,
                      trial.contacts == 1 ? "" : "s", trial.contact_s);
  if (!trial.timing.stages.empty()) text += results::format_timing(trial.timing);
  if (!result.failure.empty()) text += "FAILS  " + result.failure + "\n";
  for (const ExpectationResult& verdict : result.verdicts) {
    text += core::print("%s  %s%s: ", verdict.holds ? "holds" : "FAILS",
                        name_of(*verdict.expectation).c_str(),
                        bounds(*verdict.expectation).c_str());
    text += verdict.value ? core::print("%g\n", *verdict.value) : "not measured\n";
  }
  return text;
}

std::string to_json(const ScriptedTrial& script, const ScriptedResult& result) {
  const sim::TrialResult& trial = result.trial;
  Json faults = Json::array(), expectations = Json::array();
  for (std::size_t k = 0; k < script.fault_words.size(); ++k) {
    faults.push_back({{"at_s", script.fault_times_s[k]}, {"fault", script.fault_words[k]}});
  }
  for (const ExpectationResult& verdict : result.verdicts) {
    Json json{{"metric", verdict.expectation->metric}};
    if (!verdict.expectation->stage.empty()) json["stage"] = verdict.expectation->stage;
    if (verdict.expectation->min) json["min"] = *verdict.expectation->min;
    if (verdict.expectation->max) json["max"] = *verdict.expectation->max;
    json["value"] = number(verdict.value);
    json["holds"] = verdict.holds;
    expectations.push_back(std::move(json));
  }
  Json json{{"schema", "segsim.trial_result/1"},
            {"trial", script.name},
            {"title", script.title},
            {"program", core::version()},
            {"passed", result.passed()},
            {"failure", result.failure},
            {"seed", script.seed},
            {"clock", sim::to_string(script.clock.mode)},
            {"state_hash", core::hex(trial.state_hash)},
            {"time_s", trial.sim_s},
            {"wall_s", trial.wall_s},
            {"path_m", trial.path_m},
            {"distance_to_goal_m", number(result.distance_to_goal_m)},
            {"max_speed_mps", result.max_speed_mps},
            {"path_error_m", number(result.path_error_m)},
            {"collisions", trial.contacts},
            {"contact_s", trial.contact_s},
            {"frames_dropped", trial.frames_dropped},
            {"steps_done", result.steps_done},
            {"steps", steps_json(script, result)},
            {"faults", std::move(faults)},
            {"contacts", contacts_json(trial)},
            {"expectations", std::move(expectations)},
            {"timing", Json::parse(results::timing_json(trial.timing))}};
  return json.dump(2);
}

}  // namespace segsim::experiments::scripted_trials
