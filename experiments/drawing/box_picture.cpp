#include "experiments/drawing/box_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include <opencv2/imgproc.hpp>

#include "core/check.h"
#include "experiments/drawing/map_canvas.h"

namespace segsim::experiments::drawing {
namespace {

constexpr double kLetter = 9.0, kTitle = 13.0;
constexpr int kMargin = 10, kCaption = 20, kHead = 34;
const cv::Scalar kIgnored(150, 150, 150);

/// Colours that differ in hue and lightness (blue, green, red).
cv::Scalar class_color(int class_index) {
  static const std::array<cv::Scalar, 12> kColors{{{40, 40, 220},
                                                   {200, 110, 20},
                                                   {60, 160, 40},
                                                   {0, 150, 240},
                                                   {170, 40, 150},
                                                   {190, 170, 0},
                                                   {120, 60, 240},
                                                   {30, 110, 150},
                                                   {140, 200, 60},
                                                   {220, 60, 90},
                                                   {80, 80, 80},
                                                   {20, 200, 220}}};
  return kColors[static_cast<std::size_t>(class_index) % kColors.size()];
}

cv::Point corner(double x, double y, double scale) {
  return {static_cast<int>(std::lround(x * scale)), static_cast<int>(std::lround(y * scale))};
}

void draw_tag(cv::Mat& page, const std::string& text, const cv::Point& at,
              const cv::Scalar& color) {
  const int width = static_cast<int>(text_width_px(text, kLetter)) + 6;
  const int height = static_cast<int>(kLetter) + 7;
  const int x = std::clamp(at.x, 0, std::max(0, page.cols - width));
  const int y = std::clamp(at.y - height, 0, std::max(0, page.rows - height));
  cv::rectangle(page, {x, y, width, height}, color, cv::FILLED);
  draw_text(page, text, {x + 3.0, y + kLetter + 3.0}, kLetter, cv::Scalar(255, 255, 255));
}

void dashed_line(cv::Mat& page, const cv::Point& a, const cv::Point& b,
                 const cv::Scalar& color) {
  const double length = std::hypot(b.x - a.x, b.y - a.y);
  const int dashes = std::max(1, static_cast<int>(length / 10.0));
  for (int i = 0; i < dashes; ++i) {
    const auto at = [&](double t) {
      return cv::Point(static_cast<int>(a.x + t * (b.x - a.x)),
                       static_cast<int>(a.y + t * (b.y - a.y)));
    };
    cv::line(page, at(static_cast<double>(i) / dashes), at((i + 0.55) / dashes), color, 2,
             cv::LINE_AA);
  }
}

std::string class_text(const std::vector<std::string>& names, int index) {
  return names.at(static_cast<std::size_t>(index));
}

void draw_label(cv::Mat& page, const perception::LabeledBox& label,
                const std::vector<std::string>& names, double scale) {
  const cv::Point a = corner(label.box.x0, label.box.y0, scale);
  const cv::Point b = corner(label.box.x1, label.box.y1, scale) - cv::Point(1, 1);
  if (label.not_scored()) {
    cv::rectangle(page, a, b, kIgnored, 1);
    return;
  }
  const cv::Scalar color = class_color(label.class_index);
  cv::rectangle(page, a, b, color, 2);
  std::string text = class_text(names, label.class_index);
  if (label.truncated) text += " T";
  if (label.occluded) text += " O";
  draw_tag(page, text, a, color);
}

void draw_detection(cv::Mat& page, const core::Detection& detection,
                    const std::vector<std::string>& names, double scale) {
  const cv::Scalar color = class_color(detection.class_index);
  const cv::Point a = corner(detection.box.x0, detection.box.y0, scale);
  const cv::Point b = corner(detection.box.x1, detection.box.y1, scale) - cv::Point(1, 1);
  dashed_line(page, a, {b.x, a.y}, color);
  dashed_line(page, {b.x, a.y}, b, color);
  dashed_line(page, b, {a.x, b.y}, color);
  dashed_line(page, {a.x, b.y}, a, color);
  char score[16];
  std::snprintf(score, sizeof score, " %.2f", double{detection.score});
  draw_tag(page, class_text(names, detection.class_index) + score,
           {a.x, b.y + static_cast<int>(kLetter) + 7}, color);
}

}  // namespace

core::Image<core::Rgb8> draw_boxes(const core::Image<core::Rgb8>& image,
                                   const std::vector<perception::LabeledBox>& labels,
                                   const std::vector<core::Detection>& detections,
                                   const std::vector<std::string>& class_names, double scale) {
  SEGSIM_CHECK(scale > 0.0 && !image.empty(), "picture");
  cv::Mat page;
  cv::resize(to_bgr(image), page, {}, scale, scale,
             scale < 1.0 ? cv::INTER_AREA : cv::INTER_LINEAR);
  for (const bool scored : {false, true}) {
    for (const perception::LabeledBox& label : labels) {
      if (label.not_scored() != scored) draw_label(page, label, class_names, scale);
    }
  }
  for (const core::Detection& detection : detections) {
    draw_detection(page, detection, class_names, scale);
  }
  return from_bgr(page);
}

core::Image<core::Rgb8> picture_sheet(const std::vector<SheetPicture>& pictures, int columns,
                                      const std::string& title) {
  SEGSIM_CHECK(columns > 0 && !pictures.empty(), "sheet");
  const int width = pictures.front().image.width_px();
  const int height = pictures.front().image.height_px();
  columns = std::min(columns, static_cast<int>(pictures.size()));
  const int rows = (static_cast<int>(pictures.size()) + columns - 1) / columns;
  cv::Mat page(kHead + rows * (height + kCaption + kMargin) + kMargin,
               kMargin + columns * (width + kMargin), CV_8UC3, cv::Scalar(255, 255, 255));
  draw_text(page, title, {static_cast<double>(kMargin), 22.0}, kTitle, ink::kText, true);
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const int column = static_cast<int>(i) % columns, row = static_cast<int>(i) / columns;
    const cv::Rect cell(kMargin + column * (width + kMargin),
                        kHead + row * (height + kCaption + kMargin), width, height);
    cv::Mat picture = to_bgr(pictures[i].image);
    const double fit = std::min({1.0, static_cast<double>(width) / picture.cols,
                                 static_cast<double>(height) / picture.rows});
    if (fit < 1.0) cv::resize(picture, picture, {}, fit, fit, cv::INTER_AREA);
    const cv::Rect place(cell.x, cell.y, std::min(width, picture.cols),
                         std::min(height, picture.rows));
    picture(cv::Rect(0, 0, place.width, place.height)).copyTo(page(place));
    draw_text(page, pictures[i].caption, {static_cast<double>(cell.x), cell.y + height + 14.0},
              kLetter, ink::kText);
  }
  return from_bgr(page);
}

}  // namespace segsim::experiments::drawing
