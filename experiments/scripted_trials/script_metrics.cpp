#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

#include "core/formatted.h"
#include "experiments/scripted_trials/internal/script_metrics.h"

namespace segsim::experiments::scripted_trials {
namespace {

double distance_to_line_m(const glm::dvec2& p_m, const std::vector<glm::dvec2>& corners_m) {
  double best_m = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k + 1 < corners_m.size(); ++k) {
    const glm::dvec2 along = corners_m[k + 1] - corners_m[k];
    const double length2 = glm::dot(along, along);
    const double t = length2 > 0.0
                         ? std::clamp(glm::dot(p_m - corners_m[k], along) / length2, 0.0, 1.0)
                         : 0.0;
    best_m = std::min(best_m, glm::distance(p_m, corners_m[k] + t * along));
  }
  return best_m;
}

std::optional<double> path_error_m(const BoundScript& bound, const ScriptedResult& result) {
  std::optional<double> worst_m;
  for (const StepOutcome& step : result.steps) {
    const auto index = static_cast<std::size_t>(step.step);
    if (bound.script->steps[index].kind != StepKind::kFollow) continue;
    std::vector<glm::dvec2> line_m = bound.places_m[index];
    bool first = true;
    for (const sim::TickRecord& tick : result.trial.track) {
      const bool inside =
          tick.time_ns >= step.begin_ns && (step.end_ns < 0 || tick.time_ns <= step.end_ns);
      if (!inside) continue;
      const glm::dvec2 p_m(tick.pose.x_m, tick.pose.y_m);
      // The way to the first corner is part of it.
      if (std::exchange(first, false)) line_m.insert(line_m.begin(), p_m);
      worst_m = std::max(worst_m.value_or(0.0), distance_to_line_m(p_m, line_m));
    }
  }
  return worst_m;
}

double distance_to_goal_m(const BoundScript& bound,
                          const std::map<std::string, sim::Episode>& goals,
                          const sim::TrialResult& trial) {
  std::vector<glm::dvec2> places_m;
  for (std::size_t k = 0; k < bound.places_m.size(); ++k) {
    const ScriptStep& step = bound.script->steps[k];
    if (!bound.places_m[k].empty()) places_m = {bound.places_m[k].back()};
    if (step.kind == StepKind::kFind) places_m = goals.at(step.category).view_points_m;
  }
  if (places_m.empty()) return std::numeric_limits<double>::infinity();
  const glm::dvec2 end_m(trial.final_pose.x_m, trial.final_pose.y_m);
  return bound.world.distance_to(places_m).at(end_m, sim::DistanceField::kBaseSnap_m);
}

const FindResult* find_of(const ScriptedResult& result, int step) {
  const auto found = std::find_if(result.finds.begin(), result.finds.end(),
                                  [step](const FindResult& f) { return f.step == step; });
  return found == result.finds.end() ? nullptr : &*found;
}

/// Why the step is not done; empty if it is.
std::string failure_of(const ScriptedTrial& script, const ScriptedResult& result,
                       std::size_t k) {
  const std::string name =
      core::print("step %zu (%s) ", k + 1, to_string(script.steps[k].kind));
  const std::string outcome = sim::to_string(result.trial.outcome);
  if (k >= result.steps.size()) return name + "was not begun: " + outcome;
  const StepOutcome& step = result.steps[k];
  if (!step.end) return name + "was not finished: " + outcome;
  if (*step.end != StepEnd::kDone) {
    const std::string why = reason_of(step);
    return name + to_string(*step.end) + (why.empty() ? "" : ": " + why);
  }
  const FindResult* find = find_of(result, step.step);
  if (find != nullptr && !find->success) {
    return name +
           core::print("stopped %.2f m from a view point with %d px of the goal in view",
                       find->view_point_m, find->visible_px);
  }
  return {};
}

void count_steps(const ScriptedTrial& script, ScriptedResult& result) {
  for (std::size_t k = 0; k < script.steps.size(); ++k) {
    const std::string failure = failure_of(script, result, k);
    result.steps_done += failure.empty() ? 1 : 0;
    if (result.failure.empty()) result.failure = failure;
  }
}

/// "obs_age_ms.p95" -> 0.95.
double share_of(const std::string& metric) {
  const std::string ending = metric.substr(metric.find('.') + 1);
  return ending == "max" ? 1.0 : std::stod(ending.substr(1)) / 100.0;
}

std::optional<double> percentile_ms(const sim::DurationSamples& samples,
                                    const std::string& metric) {
  if (samples.count() == 0) return std::nullopt;
  return sim::ms_from_ns(samples.percentile(share_of(metric)));
}

std::optional<double> stage_value(const Expectation& wanted, const sim::TimingReport& timing) {
  const sim::StageTiming* stage =
      wanted.stage == "end_to_end" ? &timing.end_to_end : timing.find(wanted.stage);
  if (stage == nullptr) return std::nullopt;
  if (wanted.metric == "stage_drops") return stage->drops;
  if (wanted.metric.starts_with("stage_ms")) {
    return percentile_ms(stage->response, wanted.metric);
  }
  // A rate over nothing is none, and without a deadline nothing can be missed.
  if (stage->response.count() == 0 || stage->deadline_ns <= 0) return std::nullopt;
  if (wanted.metric == "longest_miss_run") return stage->longest_miss_run;
  return static_cast<double>(stage->misses) / stage->response.count();
}

}  // namespace

int step_at(const std::vector<StepOutcome>& steps, core::TimeNs time_ns) {
  int at = -1;
  for (const StepOutcome& step : steps) {
    if (step.begin_ns <= time_ns) at = step.step;
  }
  return at;
}

std::optional<double> value_of(const Expectation& wanted, const ScriptedResult& result) {
  const sim::TrialResult& trial = result.trial;
  if (metric_needs_stage(wanted.metric)) return stage_value(wanted, trial.timing);
  if (wanted.metric.starts_with("obs_age_ms")) {
    return percentile_ms(trial.timing.age, wanted.metric);
  }
  if (wanted.metric == "path_error_m") return result.path_error_m;
  if (wanted.metric == "distance_to_goal_m") {
    return std::isfinite(result.distance_to_goal_m) ? std::optional(result.distance_to_goal_m)
                                                    : std::nullopt;
  }
  const auto found_goals = std::count_if(result.finds.begin(), result.finds.end(),
                                         [](const FindResult& find) { return find.success; });
  const std::array<std::pair<const char*, double>, 9> numbers{{
      {"collisions", trial.contacts},
      {"contact_s", trial.contact_s},
      {"path_m", trial.path_m},
      {"time_s", trial.sim_s},
      {"max_speed_mps", result.max_speed_mps},
      {"steps_done", result.steps_done},
      {"finds", static_cast<double>(found_goals)},
      {"frames_dropped", trial.frames_dropped},
      {"ticks_without_news", trial.timing.ticks_without_news},
  }};
  for (const auto& [name, value] : numbers) {
    if (wanted.metric == name) return value;
  }
  return std::nullopt;
}

void measure(const BoundScript& bound, const std::map<std::string, sim::Episode>& goals,
             ScriptedResult& result) {
  const std::vector<sim::TickRecord>& track = result.trial.track;
  for (std::size_t k = 1; k < track.size(); ++k) {
    const core::Pose2 &a = track[k - 1].pose, &b = track[k].pose;
    const double speed_mps = std::hypot(b.x_m - a.x_m, b.y_m - a.y_m) /
                             core::seconds(track[k].time_ns - track[k - 1].time_ns);
    result.max_speed_mps = std::max(result.max_speed_mps, speed_mps);
  }
  result.distance_to_goal_m = distance_to_goal_m(bound, goals, result.trial);
  result.path_error_m = path_error_m(bound, result);
  count_steps(*bound.script, result);
  for (const Expectation& wanted : bound.script->expectations) {
    ExpectationResult verdict{&wanted, value_of(wanted, result), false};
    // What was not measured is not what was expected.
    verdict.holds = verdict.value && *verdict.value >= wanted.min.value_or(-INFINITY) &&
                    *verdict.value <= wanted.max.value_or(INFINITY);
    result.verdicts.push_back(verdict);
  }
}

bool ScriptedResult::passed() const {
  return failure.empty() &&
         std::all_of(verdicts.begin(), verdicts.end(),
                     [](const ExpectationResult& verdict) { return verdict.holds; });
}

}  // namespace segsim::experiments::scripted_trials
