// Pictures of a comparison: precision over recall, confusion, the worst images.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include <opencv2/imgproc.hpp>

#include "experiments/detection/comparison_files.h"
#include "experiments/drawing/box_picture.h"
#include "experiments/drawing/map_canvas.h"
#include "perception/data/image_file.h"

namespace segsim::experiments::detection {
namespace {

using perception::ConfusionMatrix;
using perception::ImageResult;
using perception::Miss;
using perception::MissKind;

constexpr int kOversampling = 2;
const cv::Scalar kGrid(230, 228, 226), kBefore(150, 150, 150), kAfter(196, 116, 30);

core::Image<core::Rgb8> reduced(const cv::Mat& page) {
  cv::Mat small;
  cv::resize(page, small, cv::Size(page.cols / kOversampling, page.rows / kOversampling), 0, 0,
             cv::INTER_AREA);
  return drawing::from_bgr(small);
}

void draw_curve(cv::Mat& page, const cv::Rect2d& plot,
                const std::array<double, perception::kRecallPoints>& precision,
                const cv::Scalar& color, double width_px) {
  std::vector<cv::Point> points;
  for (std::size_t k = 0; k < precision.size(); ++k) {
    points.emplace_back(
        static_cast<int>(plot.x + plot.width * static_cast<double>(k) / 100.0),
        static_cast<int>(plot.y + plot.height * (1.0 - std::max(0.0, precision[k]))));
  }
  cv::polylines(page, points, false, color, static_cast<int>(width_px), cv::LINE_AA);
}

/// Axes from 0 to 1, both curves, the title above with the areas below them.
void draw_panel(cv::Mat& page, const cv::Rect2d& plot, const PrecisionCurve& curve,
                double letter_px) {
  for (int k = 0; k <= 4; ++k) {
    const double x = plot.x + plot.width * k / 4.0, y = plot.y + plot.height * k / 4.0;
    cv::line(page, cv::Point2d(x, plot.y), cv::Point2d(x, plot.y + plot.height), kGrid, 2);
    cv::line(page, cv::Point2d(plot.x, y), cv::Point2d(plot.x + plot.width, y), kGrid, 2);
  }
  cv::rectangle(page, plot, drawing::ink::kFaint, 2);
  draw_curve(page, plot, curve.before, kBefore, 5);
  draw_curve(page, plot, curve.after, kAfter, 5);
  const auto area = [](const auto& values) {
    double sum = 0.0;
    for (const double value : values) sum += value;
    return 100.0 * sum / perception::kRecallPoints;
  };
  char text[96];
  std::snprintf(text, sizeof text, "%s  %.0f -> %.0f", curve.name.c_str(), area(curve.before),
                area(curve.after));
  drawing::draw_text(page, text, {plot.x, plot.y - 0.6 * letter_px}, letter_px,
                     drawing::ink::kText, true);
}

std::string axis_name(const SetComparison& set, int index, const char* none) {
  return index < set.before.confusion.class_count
             ? set.dataset.class_names[static_cast<std::size_t>(index)]
             : none;
}

/// Classes that occur, as truth or as detection, in either matrix; "nothing" last.
std::vector<int> shown_classes(const SetComparison& set) {
  std::vector<int> shown;
  const int classes = set.before.confusion.class_count;
  for (int c = 0; c < classes; ++c) {
    int sum = 0;
    for (int other = 0; other <= classes; ++other) {
      for (const ConfusionMatrix* m : {&set.before.confusion, &set.after.confusion}) {
        sum += m->at(c, other) + m->at(other, c);
      }
    }
    if (sum > 0) shown.push_back(c);
  }
  shown.push_back(classes);
  return shown;
}

/// One matrix with its upper left cell at (left, top).
void draw_matrix(cv::Mat& page, const SetComparison& set, const ConfusionMatrix& matrix,
                 const std::vector<int>& shown, double left, double top, double cell) {
  const double letter = 0.26 * cell;
  for (std::size_t r = 0; r < shown.size(); ++r) {
    int row_sum = 0;
    for (const int column : shown) row_sum += matrix.at(shown[r], column);
    for (std::size_t c = 0; c < shown.size(); ++c) {
      const int count = matrix.at(shown[r], shown[c]);
      const double share = row_sum == 0 ? 0.0 : static_cast<double>(count) / row_sum;
      const double fade = std::sqrt(share);
      const bool right = shown[r] == shown[c];
      const cv::Scalar full = right ? cv::Scalar(80, 150, 40) : cv::Scalar(60, 90, 220);
      const cv::Scalar color = full * fade + cv::Scalar(255, 255, 255) * (1.0 - fade);
      const cv::Rect2d box(left + static_cast<double>(c) * cell,
                           top + static_cast<double>(r) * cell, cell, cell);
      cv::rectangle(page, box, color, cv::FILLED);
      cv::rectangle(page, box, kGrid, 2);
      if (count == 0) continue;
      const std::string text = std::to_string(count);
      drawing::draw_text(
          page, text,
          {box.x + 0.5 * (cell - drawing::text_width_px(text, letter)), box.y + 0.62 * cell},
          letter, fade > 0.7 ? cv::Scalar(255, 255, 255) : drawing::ink::kText);
    }
    const std::string name = axis_name(set, shown[r], "nothing there");
    drawing::draw_text(page, name,
                       {left - 10 - drawing::text_width_px(name, letter),
                        top + (static_cast<double>(r) + 0.62) * cell},
                       letter, drawing::ink::kText);
    const std::string column = axis_name(set, shown[r], "not found").substr(0, 7);
    drawing::draw_text(page, column, {left + static_cast<double>(r) * cell + 4, top - 10},
                       0.8 * letter, drawing::ink::kText);
  }
}

/// How bad one error is, [0, 1].
double weight_of(const Miss& miss, const ImageResult& result,
                 const perception::LabeledImage& image) {
  if (miss.kind != MissKind::kMissed) {
    return double{result.detections[static_cast<std::size_t>(miss.detection)].score};
  }
  const double area =
      double{result.truth[static_cast<std::size_t>(miss.truth)].box.area_px2()};
  return std::sqrt(area / (static_cast<double>(image.width_px) * image.height_px));
}

struct WorstImage {
  std::size_t image = 0;
  double weight = 0.0;
  int missed = 0, wrong = 0, nothing_there = 0;
};

std::vector<WorstImage> worst_images(const SetComparison& set) {
  std::vector<WorstImage> worst(set.dataset.images.size());
  for (std::size_t i = 0; i < worst.size(); ++i) worst[i].image = i;
  for (const Miss& miss : set.after.confusion.misses) {
    const auto i = static_cast<std::size_t>(miss.image);
    worst[i].weight += weight_of(miss, set.after_results[i], set.dataset.images[i]);
    if (miss.kind == MissKind::kMissed) ++worst[i].missed;
    if (miss.kind == MissKind::kWrongClass) ++worst[i].wrong;
    if (miss.kind == MissKind::kBackground) ++worst[i].nothing_there;
  }
  std::stable_sort(worst.begin(), worst.end(),
                   [](const auto& a, const auto& b) { return a.weight > b.weight; });
  std::erase_if(worst, [](const WorstImage& image) { return image.weight <= 0.0; });
  return worst;
}

}  // namespace

core::Image<core::Rgb8> draw_precision_curves(const SetComparison& set) {
  constexpr double kUnit = kOversampling;
  constexpr double kLarge = 420 * kUnit, kSmall = 150 * kUnit, kGap = 34 * kUnit;
  constexpr int kColumns = 4;
  const int small = static_cast<int>(set.curves.size()) - 1;
  const int rows = std::max(3, (small + kColumns - 1) / kColumns);
  const double width = 3 * kGap + kLarge + kColumns * (kSmall + 0.6 * kGap);
  const double height = 2 * kGap + std::max(kLarge + kGap, rows * (kSmall + kGap));
  cv::Mat page(static_cast<int>(height), static_cast<int>(width), CV_8UC3,
               cv::Scalar(255, 255, 255));
  drawing::draw_text(
      page,
      set.name + ": precision over recall at IoU 0.5, AP50 before (grey) -> after (blue)",
      {kGap, 0.7 * kGap}, 12 * kUnit, drawing::ink::kText, true);
  for (std::size_t i = 0; i < set.curves.size(); ++i) {
    cv::Rect2d plot(kGap, 2 * kGap, kLarge, kLarge);
    if (i > 0) {
      const int column = static_cast<int>(i - 1) % kColumns;
      const int row = static_cast<int>(i - 1) / kColumns;
      plot = {2.2 * kGap + kLarge + column * (kSmall + 0.6 * kGap),
              2 * kGap + row * (kSmall + kGap), kSmall, kSmall};
    }
    draw_panel(page, plot, set.curves[i], (i == 0 ? 11 : 8.5) * kUnit);
  }
  return reduced(page);
}

core::Image<core::Rgb8> draw_confusion(const SetComparison& set) {
  constexpr double kUnit = kOversampling;
  constexpr double kCell = 44 * kUnit, kNames = 125 * kUnit, kTop = 70 * kUnit;
  const std::vector<int> shown = shown_classes(set);
  const double side = kCell * static_cast<double>(shown.size());
  cv::Mat page(static_cast<int>(kTop + side + 20 * kUnit),
               static_cast<int>(2 * (kNames + side) + 30 * kUnit), CV_8UC3,
               cv::Scalar(255, 255, 255));
  const double right = kNames + side + kNames + 10 * kUnit;
  for (const bool after : {false, true}) {
    const DetectorErrors& errors = after ? set.after : set.before;
    char title[160];
    std::snprintf(title, sizeof title,
                  "%s, %s: rows are there, columns detected, score >= %.2f", set.name.c_str(),
                  after ? "after" : "before", errors.score_threshold);
    drawing::draw_text(page, title, {(after ? right : kNames) - 60 * kUnit, 22 * kUnit},
                       10 * kUnit, drawing::ink::kText, true);
    draw_matrix(page, set, errors.confusion, shown, after ? right : kNames, kTop, kCell);
  }
  return reduced(page);
}

core::Image<core::Rgb8> draw_worst_misses(const SetComparison& set, int count) {
  std::vector<drawing::SheetPicture> pictures;
  for (const WorstImage& worst : worst_images(set)) {
    if (static_cast<int>(pictures.size()) == count) break;
    const perception::LabeledImage& image = set.dataset.images[worst.image];
    const ImageResult& result = set.after_results[worst.image];
    std::vector<core::Detection> shown;
    for (const core::Detection& detection : result.detections) {
      if (double{detection.score} >= set.after.score_threshold) shown.push_back(detection);
    }
    const double scale = std::clamp(400.0 / image.width_px, 0.2, 2.0);
    char caption[160];
    std::snprintf(caption, sizeof caption, "%s: %d missed, %d confused, %d false",
                  std::filesystem::path(image.file).stem().string().c_str(), worst.missed,
                  worst.wrong, worst.nothing_there);
    pictures.push_back(
        {drawing::draw_boxes(perception::read_image(set.dataset.image_file(image)),
                             result.truth, shown, set.dataset.class_names, scale),
         caption});
  }
  if (pictures.empty()) return {};
  return drawing::picture_sheet(
      pictures, 3, set.name + ", after: worst images (labels solid, detections dashed)");
}

}  // namespace segsim::experiments::detection
