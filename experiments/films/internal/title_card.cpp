#include "experiments/films/internal/title_card.h"

#include <algorithm>
#include <sstream>

#include <opencv2/imgproc.hpp>

#include "core/formatted.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/drawing/map_legend.h"
#include "experiments/films/internal/pages.h"
#include "experiments/results/training_grids.h"

namespace segsim::experiments::films::internal {
namespace {

// Cards are drawn twice as large and reduced, which smooths letters.
constexpr int kOver = 2;
constexpr double kLeft = 90.0 * kOver;
constexpr double kWidth = (kScreenWidth_px - 180.0) * kOver;

cv::Mat blank() {
  return {kScreenHeight_px * kOver, kScreenWidth_px * kOver, CV_8UC3,
          cv::Scalar(255, 255, 255)};
}

cv::Mat reduced(const cv::Mat& card) {
  cv::Mat small;
  cv::resize(card, small, {kScreenWidth_px, kScreenHeight_px}, 0.0, 0.0, cv::INTER_AREA);
  return small;
}

/// @return  The baseline of the line after the text.
double draw_wrapped(cv::Mat& card, const std::string& text, double y, double letter_px,
                    const cv::Scalar& color, bool bold = false) {
  for (const std::string& line : wrapped(text, letter_px, kWidth, bold)) {
    drawing::draw_text(card, line, {kLeft, y}, letter_px, color, bold);
    y += 1.9 * letter_px;
  }
  return y;
}

/// A row of the results: one arm in one group of episodes.
void draw_rate(cv::Mat& card, double y, const results::ArmSummary& arm,
               const cv::Scalar& color) {
  constexpr double kBar = kLeft + 170.0 * kOver, kFull = 500.0 * kOver, kHeight = 11.0 * kOver;
  constexpr double kLetter = 10.0 * kOver;
  const auto at = [&](double rate) { return static_cast<int>(kBar + kFull * rate); };
  const auto up = [&](double dy) { return static_cast<int>(y + dy); };
  drawing::draw_text(card, arm.arm, {kLeft + 16.0 * kOver, y + 0.5 * kLetter}, kLetter,
                     drawing::ink::kText);
  cv::rectangle(card, {at(0.0), up(-kHeight)}, {at(1.0), up(kHeight)},
                cv::Scalar(238, 238, 236), cv::FILLED);
  cv::rectangle(card, {at(0.0), up(-kHeight)}, {at(arm.success.value()), up(kHeight)}, color,
                cv::FILLED);
  const results::Interval interval = arm.interval();
  cv::line(card, {at(interval.low), up(0)}, {at(interval.high), up(0)}, drawing::ink::kText,
           2 * kOver);
  for (const double end : {interval.low, interval.high}) {
    cv::line(card, {at(end), up(-0.6 * kHeight)}, {at(end), up(0.6 * kHeight)},
             drawing::ink::kText, 2 * kOver);
  }
  const std::string text = core::print(
      "%.0f %% [%.0f, %.0f]   %d of %d", 100.0 * arm.success.value(), 100.0 * interval.low,
      100.0 * interval.high, arm.success.successes, arm.success.trials);
  drawing::draw_text(card, text, {kBar + kFull + 20.0 * kOver, y + 0.5 * kLetter}, kLetter,
                     drawing::ink::kText);
}

/// What of the table's notes a viewer must know.
std::vector<std::string> notes_for_viewers(const results::ResultTable& table) {
  std::vector<std::string> chosen;
  for (const std::string& note : table.notes) {
    for (const char* beginning : {"INTERIM", "ONE TRAINING", "LEAKAGE", "Fewer than"}) {
      if (note.starts_with(beginning)) chosen.push_back(note);
    }
  }
  return chosen;
}

std::string test_in_words(const results::GroupSummary& group,
                          const results::ResultTable& table) {
  const results::Interval& by = group.difference.interval;
  return core::print("%+.0f points [%+.0f, %+.0f],  p = %.2g",
                     100.0 * group.difference.difference, 100.0 * by.low, 100.0 * by.high,
                     group.p) +
         ":  " + group.verdict + core::print("  (%d episodes only ", group.pairs.only_after) +
         table.after + core::print(" solved, %d only ", group.pairs.only_before) +
         table.before + ")";
}

}  // namespace

std::vector<std::string> wrapped(const std::string& text, double letter_px, double width_px,
                                 bool bold) {
  std::vector<std::string> lines;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const std::string longer = lines.empty() ? word : lines.back() + " " + word;
    if (lines.empty() || drawing::text_width_px(longer, letter_px, bold) > width_px) {
      lines.push_back(word);
    } else {
      lines.back() = longer;
    }
  }
  return lines;
}

cv::Mat title_card(const std::string& title, const std::vector<std::string>& paragraphs) {
  constexpr double kTitle = 26.0 * kOver, kText = 14.0 * kOver;
  double height =
      1.9 * kTitle * static_cast<double>(wrapped(title, kTitle, kWidth, true).size());
  for (const std::string& text : paragraphs) {
    height += 1.9 * kText * static_cast<double>(wrapped(text, kText, kWidth).size()) + kText;
  }
  cv::Mat card = blank();
  double y = std::max(kTitle + 40.0 * kOver, 0.5 * (card.rows - height) + kTitle);
  y = draw_wrapped(card, title, y, kTitle, drawing::ink::kText, true) + kText;
  for (const std::string& text : paragraphs) {
    y = draw_wrapped(card, text, y, kText, cv::Scalar(90, 84, 80)) + kText;
  }
  return reduced(card);
}

cv::Mat reading_card(const std::string& before, const std::string& after) {
  constexpr double kTitle = 22.0 * kOver, kText = 13.0 * kOver;
  cv::Mat card = blank();
  double y = draw_wrapped(card, "How to read the screens", 190.0 * kOver, kTitle,
                          drawing::ink::kText, true);
  for (const std::string& line :
       {std::string("Left the detector \"")
                .append(before)
                .append("\", right \"")
                .append(after) +
            "\": the same episode, the same start, the same simulated time.",
        std::string(
            "Camera: rendered from the reconstruction. Thick boxes: what the detector takes "
            "for the goal. Beside it the labels of the reconstruction, which the robot "
            "does not see."),
        std::string("Map: what the robot knows, over the floor plan; grey is unknown to it. "
                    "The green boxes are the true goals, which it does not see either.")}) {
    y = draw_wrapped(card, line, y + 0.6 * kText, kText, cv::Scalar(90, 84, 80));
  }
  drawing::draw_map_legend(card, {static_cast<int>(kLeft), static_cast<int>(y + kText)},
                           static_cast<int>(kWidth), 1.15 * kOver);
  return reduced(card);
}

cv::Mat result_card(const results::ResultTable& table) {
  constexpr double kTitle = 20.0 * kOver, kHead = 12.0 * kOver, kSmall = 9.5 * kOver;
  constexpr std::size_t kMostGroups = 3;
  const cv::Scalar colors[] = {cv::Scalar(190, 184, 180), drawing::ink::kNavigate,
                               cv::Scalar(215, 205, 170)};
  cv::Mat card = blank();
  double y =
      draw_wrapped(card, table.run.title, 62.0 * kOver, kTitle, drawing::ink::kText, true);
  drawing::draw_text(card, "Share of episodes that succeeded, 95 % interval (Wilson)",
                     {kLeft, y - 6.0 * kOver}, kSmall * 1.1, drawing::ink::kFaint);
  y += 20.0 * kOver;
  std::vector<const results::GroupSummary*> groups;
  if (table.all) groups.push_back(&*table.all);
  for (const results::GroupSummary& scene : table.scenes) {
    if (groups.size() < kMostGroups) groups.push_back(&scene);
  }
  for (const results::GroupSummary* group : groups) {
    const std::string name =
        (group->title.empty() ? group->name : group->title) + (group->leak ? " *" : "");
    drawing::draw_text(card, name, {kLeft, y + 6.0 * kOver}, kHead, drawing::ink::kText, true);
    drawing::draw_text(card, test_in_words(*group, table),
                       {kLeft + 170.0 * kOver, y + 6.0 * kOver}, 0.82 * kHead,
                       drawing::ink::kText, group == groups.front());
    y += 36.0 * kOver;
    std::size_t color = 0;
    for (const std::string& arm : {table.before, table.after, table.oracle}) {
      const results::ArmSummary* found = arm.empty() ? nullptr : group->find(arm);
      if (found != nullptr) {
        draw_rate(card, y, *found, colors[color]);
        y += 33.0 * kOver;
      }
      ++color;
    }
    y += 20.0 * kOver;
  }
  const std::string planned =
      table.run.planned_n > 0
          ? "Planned before the run: " + std::to_string(table.run.planned_n) +
                " episodes per scene. "
          : std::string();
  const std::string test = table.trainings.size() > 1
                               ? "p: two-sided test over " +
                                     results::internal::trainings_in_words(table) +
                                     " and the same episodes."
                               : "p: exact two-sided McNemar test on the same episodes.";
  y = draw_wrapped(card, planned + test, y + 4.0 * kOver, kSmall, drawing::ink::kFaint);
  for (const std::string& note : notes_for_viewers(table)) {
    y = draw_wrapped(
        card, note, y, kSmall,
        note.starts_with("INTERIM") ? drawing::ink::kRecover : drawing::ink::kFaint);
  }
  return reduced(card);
}

}  // namespace segsim::experiments::films::internal
