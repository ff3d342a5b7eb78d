#include "experiments/dashboard/internal/run_json.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <optional>

#include "experiments/records/row_words.h"

namespace segsim::experiments::dashboard::internal {
namespace {

/// A worker is at work if it wrote within that time; a run too if a trial finished.
constexpr double kAliveFor_s = 30.0, kRunningFor_s = 180.0;
/// A gap so much longer than the mean before it was a pause.
constexpr double kPauseFactor = 20.0, kShortestPause_s = 120.0;

/// Seconds since 1970 of "2026-01-31T12:00:00Z".
std::optional<double> seconds_of(const std::string& utc) {
  std::tm parts{};
  const char* end = strptime(utc.c_str(), "%Y-%m-%dT%H:%M:%SZ", &parts);
  if (end == nullptr || *end != '\0') return std::nullopt;
  return static_cast<double>(timegm(&parts));
}

std::vector<double> all_seconds(const std::vector<std::string>& times) {
  std::vector<double> seconds;
  for (const std::string& time : times) {
    if (const std::optional<double> s = seconds_of(time)) seconds.push_back(*s);
  }
  return seconds;
}

Json json_interval(const results::Interval& interval) { return {interval.low, interval.high}; }

Json json_arm(const results::ArmSummary& arm) {
  const results::Interval interval = arm.interval();
  return {{"name", arm.arm},
          {"successes", arm.success.successes},
          {"episodes", arm.success.trials},
          {"trainings", arm.members},
          {"rate", arm.success.trials > 0 ? Json(arm.success.value()) : Json()},
          {"interval", json_interval(interval)},
          {"trials", arm.trials},
          {"failed", arm.failed_trials},
          {"spl", arm.spl}};
}

/// Both arms on the same episodes; null if there are no two, or no pair yet.
Json json_pair(const results::ResultTable& table, const results::GroupSummary& group) {
  if (table.before.empty() || table.after.empty() || group.pairs.total() == 0) return nullptr;
  return {{"before", table.before},
          {"after", table.after},
          {"pairs", group.pairs.total()},
          {"gained", group.pairs.only_after},
          {"lost", group.pairs.only_before},
          {"difference", group.difference.difference},
          {"interval", json_interval(group.difference.interval)},
          {"p", group.p}};
}

std::string state_of(const RunSnapshot& run, int left, std::size_t alive, const Pace& pace) {
  if (!run.stored.run.ended.empty() || left == 0) return "finished";
  if (alive > 0) return "running";
  if (pace.since_last_s >= 0.0 && pace.since_last_s < kRunningFor_s) return "running";
  return "stopped";
}

}  // namespace

std::string json_text(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Pace pace_of(const std::vector<std::string>& finish_times, const std::string& now) {
  const std::vector<double> times_s = all_seconds(finish_times);
  const std::optional<double> now_s = seconds_of(now);
  Pace pace;
  if (times_s.empty() || !now_s) return pace;
  pace.since_last_s = std::max(0.0, *now_s - times_s.front());
  std::size_t used = 1;
  for (; used < times_s.size(); ++used) {
    const double gap_s = times_s[used - 1] - times_s[used];
    const double mean_s =
        used > 1 ? (times_s.front() - times_s[used - 1]) / static_cast<double>(used - 1) : 0.0;
    if (gap_s < 0.0 || gap_s > std::max(kShortestPause_s, kPauseFactor * mean_s)) break;
  }
  // Times are whole seconds, so a burst within one of them has no pace.
  const double span_s = times_s.front() - times_s[used - 1];
  if (used > 1 && span_s > 0.0) pace.trials_per_s = static_cast<double>(used - 1) / span_s;
  return pace;
}

Json overview_json(const RunSnapshot& run, const std::vector<LiveFile>& live,
                   const std::string& now) {
  const records::RunRow& row = run.stored.run;
  const auto done = static_cast<int>(
      std::count_if(run.stored.trials.begin(), run.stored.trials.end(),
                    [](const records::TrialRow& trial) { return !trial.failed(); }));
  const int left = std::max(0, row.planned_trials - done);
  const auto alive = static_cast<std::size_t>(
      std::count_if(live.begin(), live.end(),
                    [](const LiveFile& file) { return file.age_s < kAliveFor_s; }));
  const Pace pace = pace_of(run.finish_times, now);
  const std::string state = state_of(run, left, alive, pace);
  Json json{{"key", run.key},
            {"name", row.name},
            {"title", row.title.empty() ? row.name : row.title},
            {"folder", run.stored.folder.string()},
            {"run_id", row.run_id},
            {"state", state},
            {"interim", state != "finished"},
            {"started", row.started},
            {"ended", row.ended},
            {"rule", row.success_profile},
            {"host", row.host},
            {"version", row.code_version},
            {"planned", row.planned_trials},
            {"done", done},
            {"failed", static_cast<int>(run.stored.trials.size()) - done},
            {"workers", alive},
            {"since_last_s", pace.since_last_s < 0.0 ? Json() : Json(pace.since_last_s)},
            {"eta_s", nullptr},
            {"scenes", Json::array()},
            {"arms", Json::array()},
            {"pair", nullptr}};
  if (state == "running" && pace.trials_per_s > 0.0) {
    json["eta_s"] = std::round(left / pace.trials_per_s);
  }
  for (const records::SceneRow& scene : run.stored.scenes) {
    json["scenes"].push_back({{"name", scene.name}, {"title", scene.title}});
  }
  const results::GroupSummary* group = nullptr;
  if (run.table.all) {
    group = &*run.table.all;
  } else if (!run.table.scenes.empty()) {
    group = &run.table.scenes.front();
  }
  if (group == nullptr) return json;
  for (const results::ArmSummary& arm : group->arms) json["arms"].push_back(json_arm(arm));
  json["pair"] = json_pair(run.table, *group);
  return json;
}

Json trial_json(const records::TrialRow& t) {
  return {{"id", t.trial_id},
          {"scene", t.scene},
          {"episode", t.episode},
          {"goal", t.goal_class},
          {"arm", t.arm},
          {"repetition", t.repetition},
          {"outcome", to_string(t.outcome)},
          {"cause", records::word_of(t.why.cause)},
          {"success", t.success},
          {"spl", t.spl},
          {"sim_s", t.sim_s},
          {"wall_s", t.wall_s},
          {"path_m", t.path_m},
          {"ticks", t.ticks},
          {"contacts", t.contacts},
          {"render_ms", t.render_ms},
          {"detect_ms", t.detect_ms},
          {"policy_ms", t.policy_ms},
          {"error", t.error},
          {"has_log", !t.log.empty()}};
}

Json trials_json(const RunSnapshot& run, std::size_t offset, std::size_t count) {
  std::vector<const records::TrialRow*> newest;
  for (const records::TrialRow& trial : run.stored.trials) newest.push_back(&trial);
  std::sort(newest.begin(), newest.end(),
            [](const records::TrialRow* a, const records::TrialRow* b) {
              return a->trial_id > b->trial_id;
            });
  Json json{{"total", newest.size()}, {"offset", offset}, {"trials", Json::array()}};
  for (std::size_t k = offset; k < newest.size() && k - offset < count; ++k) {
    json["trials"].push_back(trial_json(*newest[k]));
  }
  return json;
}

}  // namespace segsim::experiments::dashboard::internal
