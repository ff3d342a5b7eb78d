#include "experiments/runs/trial_picture.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <opencv2/imgproc.hpp>

#include "experiments/internal/map_canvas.h"

namespace segsim::experiments {
namespace {

constexpr int kOversampling = 2;
// Sizes in pixels of the finished picture, times the oversampling.
constexpr int kMargin = 24 * kOversampling;
constexpr int kHeader = 92 * kOversampling;
constexpr int kLegendRow = 30 * kOversampling;
constexpr int kMinWidth = 760 * kOversampling;

std::string print(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string outcome_words(const sim::TrialResult& result) {
  switch (result.outcome) {
    case sim::Outcome::kSuccess:
      return "SUCCESS";
    case sim::Outcome::kStoppedFar:
      return "STOPPED FAR FROM GOAL";
    case sim::Outcome::kNotVisible:
      return "STOPPED, GOAL NOT IN VIEW";
    case sim::Outcome::kTimeout:
      return "TIME OVER";
    case sim::Outcome::kGaveUp:
      return "GAVE UP";
    case sim::Outcome::kCollision:
      return "COLLISION";
    case sim::Outcome::kAborted:
      return "ABORTED: TOO LATE";
  }
  return "?";
}

std::string figures(const sim::TrialResult& result) {
  std::string text = "SPL " + print("%.2f", result.spl) + "    path " +
                     print("%.1f", result.path_m) + " m (shortest " +
                     print("%.1f", result.shortest_path_m) + " m)    " +
                     print("%.0f", result.sim_s) + " s";
  if (std::isfinite(result.distance_to_goal_m)) {
    text += "    " + print("%.1f", result.distance_to_goal_m) + " m to goal";
  }
  if (result.contacts > 0) text += "    contacts " + std::to_string(result.contacts);
  return text;
}

/// A label on a coloured ground. @return  Its right end.
double draw_pill(cv::Mat& image, const std::string& text, const cv::Point2d& at,
                 double letter_px, const cv::Scalar& color) {
  const double pad = 0.7 * letter_px;
  const double width = text_width_px(text, letter_px, true) + 2.0 * pad;
  const cv::Rect box(static_cast<int>(at.x), static_cast<int>(at.y - letter_px - pad),
                     static_cast<int>(width), static_cast<int>(letter_px + 2.0 * pad));
  cv::rectangle(image, box, color, cv::FILLED);
  draw_text(image, text, {at.x + pad, at.y}, letter_px, cv::Scalar(255, 255, 255), true);
  return at.x + width;
}

void draw_header(cv::Mat& image, const TrialScene& scene, const sim::TrialResult& result) {
  const double title_px = 19.0 * kOversampling, text_px = 12.0 * kOversampling;
  const double base_1 = kMargin + title_px;
  const double base_2 = base_1 + 40.0 * kOversampling;
  const std::string title = "Find a " + scene.episode->class_name;
  draw_text(image, title, {1.0 * kMargin, base_1}, title_px, ink::kText, true);
  draw_text(image, scene.scene_title + "  /  " + scene.episode->id,
            {kMargin + text_width_px(title, title_px, true) + 18.0 * kOversampling, base_1},
            text_px, ink::kFaint);
  const std::string arm = "detector: " + scene.arm;
  const double arm_px = text_width_px(arm, text_px, true) + 1.4 * text_px;
  draw_pill(image, arm, {image.cols - kMargin - arm_px, base_1}, text_px, ink::kText);

  const cv::Scalar color = result.success ? ink::kGoal : ink::kRecover;
  const std::string why = scene.cause.empty() ? std::string() : ": " + scene.cause;
  const double end =
      draw_pill(image, outcome_words(result) + why, {1.0 * kMargin, base_2}, text_px, color);
  draw_text(image, figures(result), {end + 14.0 * kOversampling, base_2}, text_px, ink::kText);
}

/// One entry of the legend: a symbol and a word.
struct LegendEntry {
  enum class Symbol { kLine, kDash, kDisc, kBox, kDiamond, kRing, kCross };
  Symbol symbol;
  cv::Scalar color;
  const char* word;
};

void draw_symbol(cv::Mat& image, const LegendEntry& entry, const cv::Point& center) {
  constexpr int r = 6 * kOversampling;
  const int width = 3 * kOversampling;
  const auto line = [&](int x0, int y0, int x1, int y1) {
    cv::line(image, center + cv::Point(x0, y0), center + cv::Point(x1, y1), entry.color, width,
             cv::LINE_AA);
  };
  switch (entry.symbol) {
    case LegendEntry::Symbol::kLine:
      line(-2 * r, 0, 2 * r, 0);
      break;
    case LegendEntry::Symbol::kDash:
      line(-2 * r, 0, -r, 0);
      line(r, 0, 2 * r, 0);
      line(-r / 3, 0, r / 3, 0);
      break;
    case LegendEntry::Symbol::kDisc:
      cv::circle(image, center, r - kOversampling, entry.color, cv::FILLED, cv::LINE_AA);
      break;
    case LegendEntry::Symbol::kRing:
      cv::circle(image, center, r, entry.color, kOversampling, cv::LINE_AA);
      cv::circle(image, center, r / 2, entry.color, cv::FILLED, cv::LINE_AA);
      break;
    case LegendEntry::Symbol::kBox:
      cv::rectangle(image, center - cv::Point(r, r), center + cv::Point(r, r), entry.color,
                    2 * kOversampling, cv::LINE_AA);
      break;
    case LegendEntry::Symbol::kDiamond: {
      const std::vector<std::vector<cv::Point>> corners{
          {center + cv::Point(r, 0), center + cv::Point(0, r), center - cv::Point(r, 0),
           center - cv::Point(0, r)}};
      cv::fillPoly(image, corners, entry.color, cv::LINE_AA);
      break;
    }
    case LegendEntry::Symbol::kCross:
      line(-r, -r, r, r);
      line(-r, r, r, -r);
      break;
  }
}

const std::vector<LegendEntry>& legend() {
  using Symbol = LegendEntry::Symbol;
  static const std::vector<LegendEntry> entries{
      {Symbol::kLine, ink::kInitialize, "look around"},
      {Symbol::kLine, ink::kExplore, "explore"},
      {Symbol::kLine, ink::kNavigate, "drive to object"},
      {Symbol::kLine, ink::kRecover, "recover"},
      {Symbol::kDash, ink::kShortest, "shortest way"},
      {Symbol::kRing, ink::kStart, "start"},
      {Symbol::kBox, ink::kGoal, "goal object"},
      {Symbol::kDisc, ink::kViewPoint, "seen from here"},
      {Symbol::kDisc, ink::kFrontier, "frontier"},
      {Symbol::kDiamond, ink::kDetected, "taken for goal"},
      {Symbol::kCross, ink::kRecover, "contact"},
  };
  return entries;
}

constexpr double kLegendLetter = 10.0 * kOversampling;
double entry_width(const LegendEntry& entry) {
  return text_width_px(entry.word, kLegendLetter) + 56.0 * kOversampling;
}

/// Draws the legend from `top` on, or only counts its rows if `image` is null.
int lay_out_legend(cv::Mat* image, int width, int top) {
  double x = kMargin;
  int row = 0;
  for (const LegendEntry& entry : legend()) {
    if (x > kMargin && x + entry_width(entry) > width - kMargin / 2) {
      x = kMargin;
      ++row;
    }
    if (image != nullptr) {
      const int y = top + row * kLegendRow + kLegendRow / 2;
      draw_symbol(*image, entry, {static_cast<int>(x) + 12 * kOversampling, y});
      draw_text(*image, entry.word, {x + 30.0 * kOversampling, y + 0.5 * kLegendLetter},
                kLegendLetter, ink::kText);
    }
    x += entry_width(entry);
  }
  return row + 1;
}

}  // namespace

core::Image<core::Rgb8> draw_trial(const TrialScene& scene, const sim::TrialResult& result,
                                   int long_side_px) {
  const FloorPlan& plan = *scene.plan;
  const int plan_side = std::max(plan.rgb.width_px(), plan.rgb.height_px());
  MapCanvas map(plan, static_cast<double>(kOversampling) * long_side_px / plan_side);
  map.draw_knowledge(result.final_view);
  map.draw_goals(*scene.manifest, scene.episode->class_name);
  map.draw_view_points(scene.episode->view_points_m);
  map.draw_shortest_path(scene.shortest_path_m);
  map.draw_frontiers(result.final_view);
  map.draw_track(result.track);
  map.draw_objects(result.final_view, scene.goal_index);
  map.draw_start(scene.episode->start);
  if (!result.track.empty()) map.draw_robot(result.track.back().pose, 0.0);
  for (const TrialMark& mark : scene.marks) map.draw_mark(mark.position_m, mark.text);
  map.draw_scale_bar();

  const int width = std::max(kMinWidth, map.image().cols + 2 * kMargin);
  const int legend_rows = lay_out_legend(nullptr, width, 0);
  const int height = kMargin + kHeader + map.image().rows + kMargin / 2 +
                     legend_rows * kLegendRow + kMargin / 2;
  cv::Mat page(height, width, CV_8UC3, cv::Scalar(255, 255, 255));
  draw_header(page, scene, result);
  const cv::Rect place((width - map.image().cols) / 2, kMargin + kHeader, map.image().cols,
                       map.image().rows);
  map.image().copyTo(page(place));
  cv::rectangle(page, place, ink::kFaint, kOversampling);
  lay_out_legend(&page, width, kMargin + kHeader + map.image().rows + kMargin / 2);

  cv::Mat reduced;
  cv::resize(page, reduced, cv::Size(width / kOversampling, height / kOversampling), 0, 0,
             cv::INTER_AREA);
  return from_bgr(reduced);
}

}  // namespace segsim::experiments
