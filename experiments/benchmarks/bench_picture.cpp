// Draws the curves of a benchmark.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include <opencv2/imgproc.hpp>

#include "core/check.h"
#include "experiments/benchmarks/bench_curves.h"
#include "experiments/drawing/map_canvas.h"

namespace segsim::experiments::benchmarks {
namespace {

constexpr int kOversampling = 2;
constexpr double kUnit = kOversampling;  // One pixel of the finished picture.
constexpr double kPanelWidth = 460 * kUnit, kPanelHeight = 400 * kUnit;
constexpr double kLeft = 74 * kUnit, kRight = 22 * kUnit;
constexpr double kTop = 74 * kUnit, kBottom = 62 * kUnit, kFooter = 30 * kUnit;
constexpr double kTitle = 13 * kUnit, kLetter = 9.5 * kUnit;
const cv::Scalar kGrid(232, 230, 228);

/// A round step of 1, 2 or 5 times a power of ten, for about five intervals.
double round_step(double span) {
  const double rough = span / 5.0;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (rough <= factor * power) return factor * power;
  }
  return 10.0 * power;
}

/// Values shown on one axis.
struct Axis {
  double low = 0, high = 1, step = 1;
};

Axis axis_for(std::vector<double> values, bool from_zero) {
  if (from_zero) values.push_back(0.0);
  Axis axis;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const double span = *high > *low ? *high - *low : std::max(1e-9, std::abs(*high));
  axis.step = round_step(span);
  axis.low = axis.step * std::floor(*low / axis.step + 1e-9);
  axis.high = axis.step * std::ceil(*high / axis.step - 1e-9);
  if (axis.high <= axis.low) axis.high = axis.low + axis.step;
  return axis;
}

std::string tick_text(double value, double step) {
  const int decimals = std::max(0, static_cast<int>(std::ceil(-std::log10(step) - 1e-9)));
  char text[32];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

class Panel {
 public:
  Panel(cv::Mat& page, double left, const Curve& curve)
      : page_(page), left_(left + kLeft), curve_(curve) {
    std::vector<double> y = curve.y;
    // The proportional line may leave the panel: it would flatten the measured one.
    const double limit = 2.0 * *std::max_element(y.begin(), y.end());
    for (const double value : curve.proportional) y.push_back(std::min(value, limit));
    x_ = axis_for(curve.x, true);
    y_ = axis_for(y, curve.y_from_zero);
  }

  void draw() {
    draw_axes();
    draw_dashes();
    for (std::size_t i = 1; i < curve_.x.size(); ++i) {
      line(at(curve_.x[i - 1], curve_.y[i - 1]), at(curve_.x[i], curve_.y[i]),
           drawing::ink::kExplore, 2.4);
    }
    for (std::size_t i = 0; i < curve_.x.size(); ++i) {
      cv::circle(page_, at(curve_.x[i], curve_.y[i]), static_cast<int>(4.5 * kUnit),
                 drawing::ink::kExplore, cv::FILLED, cv::LINE_AA);
    }
  }

 private:
  [[nodiscard]] double width() const { return kPanelWidth - kLeft - kRight; }
  [[nodiscard]] double height() const { return kPanelHeight - kTop - kBottom; }
  [[nodiscard]] cv::Point at(double x, double y) const {
    return {static_cast<int>(left_ + width() * (x - x_.low) / (x_.high - x_.low)),
            static_cast<int>(kTop + height() * (1.0 - (y - y_.low) / (y_.high - y_.low)))};
  }
  void line(const cv::Point& a, const cv::Point& b, const cv::Scalar& color, double width_px) {
    cv::line(page_, a, b, color, static_cast<int>(width_px * kUnit), cv::LINE_AA);
  }

  void draw_axes() {
    for (double x = x_.low; x < x_.high + 0.5 * x_.step; x += x_.step) {
      line(at(x, y_.low), at(x, y_.high), kGrid, 1);
      const std::string text = tick_text(x, x_.step);
      const cv::Point foot = at(x, y_.low);
      drawing::draw_text(
          page_, text,
          {foot.x - 0.5 * drawing::text_width_px(text, kLetter), foot.y + 18 * kUnit}, kLetter,
          drawing::ink::kText);
    }
    for (double y = y_.low; y < y_.high + 0.5 * y_.step; y += y_.step) {
      line(at(x_.low, y), at(x_.high, y), kGrid, 1);
      const std::string text = tick_text(y, y_.step);
      drawing::draw_text(page_, text,
                         {left_ - 8 * kUnit - drawing::text_width_px(text, kLetter),
                          at(x_.low, y).y + 0.5 * kLetter},
                         kLetter, drawing::ink::kText);
    }
    line(at(x_.low, y_.low), at(x_.high, y_.low), drawing::ink::kFaint, 1.5);
    line(at(x_.low, y_.low), at(x_.low, y_.high), drawing::ink::kFaint, 1.5);
    drawing::draw_text(page_, curve_.title, {left_, 24 * kUnit}, kTitle, drawing::ink::kText,
                       true);
    drawing::draw_text(page_, curve_.note, {left_, 44 * kUnit}, kLetter, drawing::ink::kFaint);
    drawing::draw_text(page_, curve_.y_label, {left_ - 50 * kUnit, 64 * kUnit}, kLetter,
                       drawing::ink::kText);
    const double label_px = drawing::text_width_px(curve_.x_label, kLetter);
    drawing::draw_text(page_, curve_.x_label,
                       {left_ + width() - label_px, kPanelHeight - kBottom + 42 * kUnit},
                       kLetter, drawing::ink::kText);
  }

  /// The proportional line, cut where it leaves the panel.
  void draw_dashes() {
    if (curve_.proportional.size() < 2) return;
    const double slope = curve_.proportional[0] / curve_.x[0];
    const double end = std::min(curve_.x.back(), y_.high / slope);
    constexpr int kDashes = 24;
    for (int i = 0; i < kDashes; ++i) {
      const double a = end * i / kDashes, b = end * (i + 0.55) / kDashes;
      line(at(a, slope * a), at(b, slope * b), drawing::ink::kFaint, 1.6);
    }
  }

  cv::Mat& page_;
  double left_;
  const Curve& curve_;
  Axis x_, y_;
};

}  // namespace

core::Image<core::Rgb8> draw_curves(const std::vector<Curve>& curves,
                                    const std::string& footer) {
  SEGSIM_CHECK(!curves.empty(), "no curve");
  const int width = static_cast<int>(kPanelWidth * static_cast<double>(curves.size()));
  const int height = static_cast<int>(kPanelHeight + kFooter);
  cv::Mat page(height, width, CV_8UC3, cv::Scalar(255, 255, 255));
  for (std::size_t i = 0; i < curves.size(); ++i) {
    SEGSIM_CHECK(!curves[i].x.empty() && curves[i].x.size() == curves[i].y.size(),
                 "points of \"" + curves[i].title + "\"");
    Panel(page, kPanelWidth * static_cast<double>(i), curves[i]).draw();
  }
  drawing::draw_text(page, footer, {kLeft, kPanelHeight + 8 * kUnit}, 0.9 * kLetter,
                     drawing::ink::kFaint);
  cv::Mat reduced;
  cv::resize(page, reduced, cv::Size(width / kOversampling, height / kOversampling), 0, 0,
             cv::INTER_AREA);
  return drawing::from_bgr(reduced);
}

}  // namespace segsim::experiments::benchmarks
