#include "experiments/drawing/map_legend.h"

#include <algorithm>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "experiments/drawing/map_canvas.h"

namespace segsim::experiments::drawing {
namespace {

/// One entry of the legend: a symbol and a word.
struct LegendEntry {
  enum class Symbol { kLine, kDash, kDisc, kBox, kDiamond, kRing, kCross };
  Symbol symbol;
  cv::Scalar color;
  const char* word;
};

void draw_symbol(cv::Mat& image, const LegendEntry& entry, const cv::Point& center,
                 double scale) {
  const int unit = std::max(1, static_cast<int>(scale));
  const int r = static_cast<int>(6.0 * scale), width = static_cast<int>(3.0 * scale);
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
      cv::circle(image, center, r - unit, entry.color, cv::FILLED, cv::LINE_AA);
      break;
    case LegendEntry::Symbol::kRing:
      cv::circle(image, center, r, entry.color, unit, cv::LINE_AA);
      cv::circle(image, center, r / 2, entry.color, cv::FILLED, cv::LINE_AA);
      break;
    case LegendEntry::Symbol::kBox:
      cv::rectangle(image, center - cv::Point(r, r), center + cv::Point(r, r), entry.color,
                    2 * unit, cv::LINE_AA);
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

constexpr double kLetter = 10.0, kRow = 30.0, kSymbol = 30.0, kSpace = 56.0;  // At scale 1.

/// Calls `place(entry, x, row)` for each entry. @return  Number of rows.
template <class Place>
int lay_out(int width_px, double scale, const Place& place) {
  double x = 0.0;
  int row = 0;
  for (const LegendEntry& entry : legend()) {
    const double width = text_width_px(entry.word, kLetter * scale) + kSpace * scale;
    if (x > 0.0 && x + width > width_px) {
      x = 0.0;
      ++row;
    }
    place(entry, x, row);
    x += width;
  }
  return row + 1;
}

}  // namespace

std::string outcome_words(sim::Outcome outcome) {
  switch (outcome) {
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

int map_legend_height_px(int width_px, double scale) {
  const int rows = lay_out(width_px, scale, [](const LegendEntry&, double, int) {});
  return static_cast<int>(rows * kRow * scale);
}

void draw_map_legend(cv::Mat& image, const cv::Point& corner, int width_px, double scale) {
  lay_out(width_px, scale, [&](const LegendEntry& entry, double x, int row) {
    const int y = corner.y + static_cast<int>((row + 0.5) * kRow * scale);
    const int left = corner.x + static_cast<int>(x);
    draw_symbol(image, entry, {left + static_cast<int>(12.0 * scale), y}, scale);
    draw_text(image, entry.word, {left + kSymbol * scale, y + 0.5 * kLetter * scale},
              kLetter * scale, ink::kText);
  });
}

}  // namespace segsim::experiments::drawing
