// Plots of a report, and their numbers as tables.
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/formatted.h"
#include "experiments/records/replay_log.h"
#include "experiments/report/internal/html.h"
#include "experiments/report/internal/report_model.h"
#include "experiments/results/table_grids.h"
#include "experiments/runs/budget_sweep.h"

namespace segsim::experiments::report::internal {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// @param grid  The same figures; its title is the plot's. @param note  Below the plot.
std::string figure(const ReportModel& model, const Json& plot, support::internal::Grid grid,
                   const std::string& note = {}, bool small = false) {
  const std::string title = grid.title;
  grid.title.clear();
  std::string html = "<figure data-plot=\"" + plot.at("kind").get<std::string>() +
                     "\"><figcaption>" + html_escaped(title) + "</figcaption>\n";
  if (model.with_plots) {
    html += "<div class=\"canvas" + std::string(small ? " small" : "") +
            R"("><canvas role="img" aria-label=")" + html_escaped(title) +
            "\"></canvas></div>\n<script type=\"application/json\">" +
            script_json(plot.dump(-1, ' ', false, Json::error_handler_t::replace)) +
            "</script>\n";
  }
  if (!note.empty()) html += "<p class=\"faint\">" + html_escaped(note) + "</p>\n";
  return html + "<details" + (model.with_plots ? "" : " open") +
         "><summary>Figures</summary>" + html_table(grid) + "</details></figure>\n";
}

Json series(const ReportModel& model, const std::string& arm) {
  return {{"name", arm}, {"color", arm_color(model, arm)}};
}

std::vector<results::GroupSummary> groups_of(const ReportModel& model) {
  std::vector<results::GroupSummary> groups = model.table.scenes;
  if (model.table.all) groups.push_back(*model.table.all);
  return groups;
}

std::vector<double> rates_of(const std::vector<results::Proportion>& proportions) {
  std::vector<double> rates;
  for (const results::Proportion& p : proportions) {
    if (p.trials > 0) rates.push_back(p.value());
  }
  return rates;
}

/// Percentage of a share.
std::string percent(double share) { return core::print("%.1f %%", 100.0 * share); }

/// Bins of equal width over what all series have in common.
struct Bins {
  double low = 0.0, width = 1.0;
  int count = 1;

  explicit Bins(std::vector<double> values) {
    constexpr int kMost = 24;
    std::sort(values.begin(), values.end());
    low = values.front();
    // The longest hundredth shares the last bin, or one stall would hide all the rest.
    const double high =
        values[static_cast<std::size_t>(0.99 * static_cast<double>(values.size() - 1))];
    count =
        std::clamp(static_cast<int>(std::sqrt(static_cast<double>(values.size()))), 1, kMost);
    width = high > low ? (high - low) / count : 1.0;
    if (high <= low) count = 1;
  }
  [[nodiscard]] int of(double value) const {
    return std::clamp(static_cast<int>((value - low) / width), 0, count - 1);
  }
};

/// @param by_arm  Values [ms] of each arm, in the order of the run's arms.
std::string histogram(const ReportModel& model, const std::string& title,
                      const std::vector<std::pair<std::string, std::vector<double>>>& by_arm,
                      const std::string& unit) {
  std::vector<double> all;
  for (const auto& [arm, values] : by_arm) all.insert(all.end(), values.begin(), values.end());
  if (all.empty()) return {};
  const Bins bins(all);
  Json plot{{"kind", "bars"}, {"x", "ms"}, {"y", unit}};
  support::internal::Grid grid{
      title, {"Arm", "n", "p50 [ms]", "p95 [ms]", "p99 [ms]", "max [ms]"}, {}};
  for (int k = 0; k < bins.count; ++k) {
    plot["labels"].push_back(core::print("%.3g", bins.low + (k + 0.5) * bins.width));
  }
  for (const auto& [arm, unsorted] : by_arm) {
    auto values = unsorted;
    if (values.empty()) continue;
    std::vector<int> counts(static_cast<std::size_t>(bins.count));
    for (const double value : values) ++counts[static_cast<std::size_t>(bins.of(value))];
    Json line = series(model, arm);
    line["values"] = counts;
    plot["series"].push_back(std::move(line));
    std::sort(values.begin(), values.end());
    const auto at = [&](double share) {
      const auto rank = std::ceil(share * static_cast<double>(values.size())) - 1.0;
      return core::print("%.1f", values[static_cast<std::size_t>(std::max(0.0, rank))]);
    };
    grid.rows.push_back(
        {arm, std::to_string(values.size()), at(0.5), at(0.95), at(0.99), at(1.0)});
  }
  return figure(model, plot, grid, {}, true);
}

/// Durations by stage and arm, from the replay logs of trials with latency.
using StageDurations = std::map<std::string, std::map<std::string, std::vector<double>>>;

StageDurations played_durations(const ReportModel& model) {
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry :
       fs::recursive_directory_iterator(model.stored->folder / "replays", error)) {
    if (entry.path().extension() == ".jsonl") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  StageDurations durations;
  for (const fs::path& file : files) {
    records::ReplayLog log;
    try {
      log = records::read_replay_log(file);
    } catch (const core::InputError&) {
      continue;  // A log that is being written, or of another version: not ours to judge.
    }
    const auto add = [&](const std::string& stage, const sim::DurationSamples& samples) {
      std::vector<double>& values = durations[stage][log.arm];
      for (const core::TimeNs value : samples.values_ns()) {
        values.push_back(static_cast<double>(value) * 1e-6);
      }
    };
    if (log.timing.stages.empty()) continue;
    for (const sim::StageTiming& stage : log.timing.stages) add(stage.name, stage.response);
    add("end to end", log.timing.end_to_end.response);
    add("age of the image in use", log.timing.age);
  }
  return durations;
}

/// "detect" of an arm "late+200ms", or nothing.
struct SweepArm {
  std::string arm;
  double add_ms = 0.0;
};
std::optional<SweepArm> sweep_arm_of(const std::string& name) {
  const std::size_t plus = name.rfind('+');
  if (plus == std::string::npos || plus == 0 || !name.ends_with("ms")) return std::nullopt;
  const std::string number = name.substr(plus + 1, name.size() - plus - 3);
  try {
    std::size_t used = 0;
    const double add_ms = std::stod(number, &used);
    if (used != number.size()) return std::nullopt;
    return SweepArm{name.substr(0, plus), add_ms};
  } catch (const std::exception&) {  // Not a number: an arm of another kind.
    return std::nullopt;
  }
}

std::string delay_figure(const ReportModel& model, const results::StoredRun& stored,
                         const std::string& where) {
  std::map<std::string, std::vector<double>> delays;
  for (const records::ArmRow& arm : stored.arms) {
    if (const auto swept = sweep_arm_of(arm.name)) delays[swept->arm].push_back(swept->add_ms);
  }
  std::string html;
  for (auto& [arm, add_ms] : delays) {
    if (add_ms.size() < 2) continue;
    std::sort(add_ms.begin(), add_ms.end());
    runs::SweepOptions options;
    options.add_ms = add_ms;
    options.arm = arm;
    const runs::SweepResult result = runs::summarise_sweep(options, arm, stored.trials);
    Json line{{"name", arm}, {"points", Json::array()}};
    support::internal::Grid grid{
        std::string("Success rate against added delay: ").append(arm).append(where),
        {"Added [ms]", "Successes", "SR", "Wilson 95 %", "Against the first [points]"},
        {}};
    for (const runs::SweepPoint& point : result.points) {
      line["points"].push_back(
          {point.add_ms, point.success.value(), point.interval.low, point.interval.high});
      grid.rows.push_back(
          {core::print("%g", point.add_ms),
           std::to_string(point.success.successes) + "/" +
               std::to_string(point.success.trials),
           percent(point.success.value()),
           percent(point.interval.low) + " to " + percent(point.interval.high),
           core::print("%+.0f [%+.0f, %+.0f]", 100.0 * point.loss.difference,
                       100.0 * point.loss.interval.low, 100.0 * point.loss.interval.high)});
    }
    const Json plot{{"kind", "lines"},
                    {"x", "added delay [ms]"},
                    {"y", "success rate"},
                    {"series", Json::array({line})}};
    html += figure(model, plot, grid);
  }
  return html;
}

}  // namespace

std::string success_figure(const ReportModel& model) {
  const bool several = model.table.trainings.size() > 1;
  Json plot{{"kind", "intervals"},
            {"x", several ? "success rate, 95 %; a small dot per training"
                          : "success rate, Wilson 95 %"}};
  support::internal::Grid grid{"Success rate with its interval",
                               {"Scene", "Arm", "Successes", "SR",
                                several ? "95 %" : "Wilson 95 %", "Clopper-Pearson 95 %"},
                               {}};
  std::set<std::string> arms;
  for (const results::GroupSummary& group : groups_of(model)) {
    for (const results::ArmSummary& arm : group.arms) {
      if (arm.success.trials == 0) continue;
      const results::Interval interval = arm.interval();
      const results::Interval exact = results::clopper_pearson_interval(arm.success);
      plot["rows"].push_back({{"label", group.title + ", " + arm.arm},
                              {"series", arm.arm},
                              {"low", interval.low},
                              {"value", arm.success.value()},
                              {"high", interval.high}});
      if (arm.members > 1) plot["rows"].back()["dots"] = rates_of(arm.by_member);
      grid.rows.push_back(
          {group.title, arm.arm,
           std::to_string(arm.success.successes) + "/" + std::to_string(arm.success.trials),
           percent(arm.success.value()),
           percent(interval.low) + " to " + percent(interval.high),
           arm.members > 1 ? "-" : percent(exact.low) + " to " + percent(exact.high)});
      if (arms.insert(arm.arm).second) plot["series"].push_back(series(model, arm.arm));
    }
  }
  return grid.rows.empty() ? std::string() : figure(model, plot, grid);
}

std::string causes_figure(const ReportModel& model) {
  std::map<std::string, std::map<std::string, int>> counts;  // By fate, then arm.
  for (const TrialView& view : model.trials) {
    if (view.row->counts() && !view.row->success) ++counts[fate_of(*view.row)][view.arm];
  }
  if (counts.empty()) return {};
  Json plot{{"kind", "bars"}, {"horizontal", true}, {"x", "failed trials"}, {"y", ""}};
  support::internal::Grid grid{"Why trials failed", {"Cause", "What it means"}, {}};
  std::vector<std::pair<int, std::string>> order;  // Most frequent first.
  for (const auto& [fate, by_arm] : counts) {
    int total = 0;
    for (const auto& [arm, count] : by_arm) total += count;
    order.emplace_back(-total, fate);
  }
  std::sort(order.begin(), order.end());
  for (const auto& [total, fate] : order) {
    plot["labels"].push_back(fate);
    grid.rows.push_back({fate, fate_in_words(fate)});
  }
  for (const std::string& arm : arms_of(model)) {
    Json line = series(model, arm);
    grid.header.push_back(arm);
    std::size_t row = 0;
    for (const auto& [total, fate] : order) {
      const std::map<std::string, int>& by_arm = counts.at(fate);
      const auto found = by_arm.find(arm);
      const int count = found == by_arm.end() ? 0 : found->second;
      line["values"].push_back(count);
      grid.rows[row++].push_back(std::to_string(count));
    }
    plot["series"].push_back(std::move(line));
  }
  return figure(model, plot, grid);
}

std::string steps_figure(const ReportModel& model) {
  Json plot{{"kind", "lines"},
            {"stepped", true},
            {"x", "control steps"},
            {"y", "trials that have succeeded"}};
  support::internal::Grid grid{
      "Success against control steps",
      {"Arm", "Trials", "Succeeded", "Median steps of successes", "Most steps"},
      {}};
  int longest = 0;
  for (const TrialView& view : model.trials) longest = std::max(longest, view.row->ticks);
  if (longest == 0) return {};
  for (const std::string& arm : arms_of(model)) {
    std::vector<int> ticks;
    int trials = 0;
    for (const TrialView& view : model.trials) {
      if (view.arm != arm || !view.row->counts()) continue;
      ++trials;
      if (view.row->success) ticks.push_back(view.row->ticks);
    }
    if (trials == 0) continue;
    std::sort(ticks.begin(), ticks.end());
    Json line = series(model, arm);
    line["points"].push_back({0, 0.0});
    for (std::size_t k = 0; k < ticks.size(); ++k) {
      if (k + 1 < ticks.size() && ticks[k + 1] == ticks[k]) continue;
      line["points"].push_back({ticks[k], static_cast<double>(k + 1) / trials});
    }
    line["points"].push_back({longest, static_cast<double>(ticks.size()) / trials});
    plot["series"].push_back(std::move(line));
    grid.rows.push_back({arm, std::to_string(trials), std::to_string(ticks.size()),
                         ticks.empty() ? "-" : std::to_string(ticks[ticks.size() / 2]),
                         ticks.empty() ? "-" : std::to_string(ticks.back())});
  }
  return grid.rows.empty() ? std::string() : figure(model, plot, grid);
}

std::string delay_figures(const ReportModel& model) {
  std::string html = delay_figure(model, *model.stored, "");
  std::vector<fs::path> sweeps;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(model.stored->folder, error)) {
    const bool named = entry.path().filename().string().starts_with("sweep-");
    if (named && fs::exists(entry.path() / "results.sqlite", error))
      sweeps.push_back(entry.path());
  }
  std::sort(sweeps.begin(), sweeps.end());
  for (const fs::path& sweep : sweeps) {
    html +=
        delay_figure(model, results::load_run(sweep), " (" + sweep.filename().string() + ")");
  }
  return html;
}

std::string latency_figures(const ReportModel& model) {
  const StageDurations played = played_durations(model);
  std::string html;
  for (const auto& [stage, by_arm] : played) {
    std::vector<std::pair<std::string, std::vector<double>>> ordered;
    for (const records::ArmRow& arm : model.table.arm_rows) {
      const auto found = by_arm.find(arm.name);
      if (found != by_arm.end()) ordered.emplace_back(arm.name, found->second);
    }
    html += histogram(model, stage + ": response times of the robot's clock", ordered, "jobs");
  }
  const std::pair<const char*, double records::TrialRow::*> stages[] = {
      {"render", &records::TrialRow::render_ms},
      {"detect", &records::TrialRow::detect_ms},
      {"policy", &records::TrialRow::policy_ms}};
  for (const auto& [stage, column] : stages) {
    std::vector<std::pair<std::string, std::vector<double>>> ordered;
    bool any = false;
    for (const std::string& arm : arms_of(model)) {
      ordered.emplace_back(arm, std::vector<double>{});
      for (const TrialView& view : model.trials) {
        if (view.arm != arm || !view.row->counts() || view.row->ticks == 0) continue;
        ordered.back().second.push_back(view.row->*column);
        any = any || view.row->*column > 0.0;
      }
    }
    if (any) {
      html +=
          histogram(model, std::string(stage) + ": wall time of the run, mean of each trial",
                    ordered, "trials");
    }
  }
  return html;
}

}  // namespace segsim::experiments::report::internal
