// A scripted trial from above.
#include <algorithm>
#include <array>
#include <cmath>

#include <opencv2/imgproc.hpp>

#include "core/formatted.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/scripted_trials/internal/script_metrics.h"
#include "experiments/scripted_trials/scripted_run.h"

namespace segsim::experiments::scripted_trials {
namespace {

constexpr int kOversampling = 2;
constexpr int kMargin = 24 * kOversampling;
constexpr int kLine = 22 * kOversampling;
constexpr double kLetter = 10.0 * kOversampling, kTitle = 17.0 * kOversampling;
constexpr int kMinWidth = 860 * kOversampling;

/// The robot's place at a time.
glm::dvec2 place_at(const std::vector<sim::TickRecord>& track, core::TimeNs time_ns) {
  const auto after =
      std::find_if(track.begin(), track.end(),
                   [&](const sim::TickRecord& tick) { return tick.time_ns >= time_ns; });
  const core::Pose2& pose = after == track.end() ? track.back().pose : after->pose;
  return {pose.x_m, pose.y_m};
}

/// One line of text below the map: a sign on a disc, and what it stands for.
struct Entry {
  std::string sign, words;
  bool good = true;
};

std::vector<Entry> entries_of(const ScriptedTrial& script, const ScriptedResult& result) {
  std::vector<Entry> entries;
  for (std::size_t k = 0; k < script.steps.size(); ++k) {
    Entry entry{std::to_string(k + 1), to_string(script.steps[k].kind), false};
    if (k >= result.steps.size()) {
      entry.words += ": not begun";
    } else {
      const StepOutcome& step = result.steps[k];
      entry.good = step.end == StepEnd::kDone;
      entry.words += core::print(", from %.1f s", core::seconds(step.begin_ns));
      entry.words += step.end ? core::print(" to %.1f s: %s", core::seconds(step.end_ns),
                                            to_string(*step.end))
                              : std::string(": not finished");
    }
    entries.push_back(std::move(entry));
  }
  for (std::size_t k = 0; k < script.fault_words.size(); ++k) {
    entries.push_back(
        {std::string(1, static_cast<char>('A' + k % 26)),
         core::print("fault at %.1f s: ", script.fault_times_s[k]) + script.fault_words[k]});
  }
  for (const sim::ContactRecord& contact : result.trial.contact_log) {
    entries.push_back(
        {"!",
         core::print("contact at %.1f s, %.2f m/s, for %.1f s", core::seconds(contact.time_ns),
                     contact.approach_mps, contact.duration_s),
         false});
  }
  for (const ExpectationResult& verdict : result.verdicts) {
    const Expectation& wanted = *verdict.expectation;
    std::string words = wanted.metric + (wanted.stage.empty() ? "" : " of " + wanted.stage);
    if (wanted.min) words += core::print(" >= %g", *wanted.min);
    if (wanted.max) words += core::print(" <= %g", *wanted.max);
    words += verdict.value ? core::print(": %g", *verdict.value) : ": not measured";
    entries.push_back({verdict.holds ? "+" : "x", std::move(words), verdict.holds});
  }
  return entries;
}

void draw_entries(cv::Mat& page, const std::vector<Entry>& entries, int top, int columns) {
  const int width = (page.cols - 2 * kMargin) / columns;
  const std::size_t rows = (entries.size() + static_cast<std::size_t>(columns) - 1) /
                           static_cast<std::size_t>(columns);
  for (std::size_t k = 0; k < entries.size(); ++k) {
    const int x = kMargin + static_cast<int>(k / rows) * width;
    const int y = top + static_cast<int>(k % rows) * kLine + kLine / 2;
    const cv::Scalar color = entries[k].good ? drawing::ink::kGoal : drawing::ink::kRecover;
    cv::circle(page, {x + 9 * kOversampling, y}, 9 * kOversampling, color, cv::FILLED,
               cv::LINE_AA);
    drawing::draw_text(page, entries[k].sign,
                       {x + 9.0 * kOversampling -
                            0.5 * drawing::text_width_px(entries[k].sign, kLetter, true),
                        y + 0.5 * kLetter},
                       kLetter, cv::Scalar(255, 255, 255), true);
    drawing::draw_text(page, entries[k].words, {x + 26.0 * kOversampling, y + 0.5 * kLetter},
                       kLetter, drawing::ink::kText);
  }
}

/// The track, in one colour per step.
void draw_drive(drawing::MapCanvas& map, const ScriptedResult& result) {
  constexpr std::array kColours{core::PolicyMode::kExplore, core::PolicyMode::kNavigate,
                                core::PolicyMode::kInitialize};
  std::vector<sim::TickRecord> track = result.trial.track;
  for (sim::TickRecord& tick : track) {
    const int step = std::max(0, step_at(result.steps, tick.time_ns));
    tick.mode = kColours[static_cast<std::size_t>(step) % kColours.size()];
  }
  map.draw_track(track);
}

void draw_map(drawing::MapCanvas& map, const BoundScript& bound,
              const ScriptedResult& result) {
  const ScriptedTrial& script = *bound.script;
  const std::vector<sim::TickRecord>& track = result.trial.track;
  for (std::size_t k = 0; k < script.steps.size(); ++k) {
    if (script.steps[k].kind == StepKind::kFollow) map.draw_shortest_path(bound.places_m[k]);
    if (script.steps[k].kind == StepKind::kFind) {
      map.draw_goals(bound.bundle.manifest,
                     sim::GoalObjects(bound.bundle.manifest, script.steps[k].category));
    }
  }
  draw_drive(map, result);
  map.draw_start(bound.start);
  map.draw_robot(result.trial.final_pose, 0.0);
  if (track.empty()) return;
  for (std::size_t k = 0; k < script.steps.size(); ++k) {
    const bool placed = script.steps[k].kind == StepKind::kGoto;
    if (placed) {
      map.draw_mark(bound.places_m[k].front(), std::to_string(k + 1));
    } else if (k < result.steps.size()) {
      map.draw_mark(place_at(track, result.steps[k].begin_ns), std::to_string(k + 1));
    }
  }
  for (std::size_t k = 0; k < script.fault_words.size(); ++k) {
    const core::TimeNs at_ns = std::llround(script.fault_times_s[k] * 1e9);
    if (at_ns > track.back().time_ns) continue;
    map.draw_mark(place_at(track, at_ns), std::string(1, static_cast<char>('A' + k % 26)));
  }
  for (const sim::ContactRecord& contact : result.trial.contact_log) {
    map.draw_mark(contact.point_m, "!");
  }
  map.draw_scale_bar();
}

}  // namespace

core::Image<core::Rgb8> draw_script(const BoundScript& bound, const ScriptedResult& result,
                                    int long_side_px) {
  const drawing::FloorPlan& plan = bound.plan;
  const int plan_side = std::max(plan.rgb.width_px(), plan.rgb.height_px());
  drawing::MapCanvas map(plan, static_cast<double>(kOversampling) * long_side_px / plan_side);
  draw_map(map, bound, result);

  const std::vector<Entry> entries = entries_of(*bound.script, result);
  const int columns = 2;
  const int rows = (static_cast<int>(entries.size()) + columns - 1) / columns;
  const int width = std::max(kMinWidth, map.image().cols + 2 * kMargin);
  const int header = kMargin + static_cast<int>(kTitle) + kLine;
  const int height =
      header + kMargin / 2 + map.image().rows + kMargin + rows * kLine + kMargin;
  cv::Mat page(height, width, CV_8UC3, cv::Scalar(255, 255, 255));
  drawing::draw_text(page, bound.script->title, {1.0 * kMargin, kMargin + kTitle}, kTitle,
                     drawing::ink::kText, true);
  const bool passed = result.passed();
  const std::string line =
      std::string(passed ? "PASSED" : "FAILED") +
      core::print("   path %.1f m   %.1f s   contacts %d", result.trial.path_m,
                  result.trial.sim_s, result.trial.contacts) +
      (result.failure.empty() ? "" : "   " + result.failure);
  drawing::draw_text(page, line, {1.0 * kMargin, static_cast<double>(header)}, 1.1 * kLetter,
                     passed ? drawing::ink::kGoal : drawing::ink::kRecover, true);
  const cv::Rect place((width - map.image().cols) / 2, header + kMargin / 2, map.image().cols,
                       map.image().rows);
  map.image().copyTo(page(place));
  cv::rectangle(page, place, drawing::ink::kFaint, kOversampling);
  draw_entries(page, entries, place.y + place.height + kMargin / 2, columns);

  cv::Mat reduced;
  cv::resize(page, reduced, cv::Size(width / kOversampling, height / kOversampling), 0, 0,
             cv::INTER_AREA);
  return drawing::from_bgr(reduced);
}

}  // namespace segsim::experiments::scripted_trials
