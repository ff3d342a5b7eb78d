#include "experiments/scenes/placement_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include <glm/geometric.hpp>
#include <opencv2/imgproc.hpp>

#include "experiments/drawing/map_canvas.h"

namespace segsim::experiments::scenes {
namespace {

namespace ink = drawing::ink;
using reconstruction::SurfaceElement;

constexpr int kWidth = 1200, kTop = 64, kBottom = 28, kHeight = 640;
constexpr int kView = 860;           // Width of the side view.
constexpr int kScaleX = kView + 60;  // Where the histogram begins.
constexpr double kText = 11.0;
constexpr double kBin_m = 0.05;

enum Kind : std::size_t { kFromAbove, kFromBelow, kWall, kOther, kKinds };

const std::array<cv::Scalar, kKinds> kColors{cv::Scalar(70, 150, 10), cv::Scalar(200, 140, 40),
                                             cv::Scalar(110, 105, 100),
                                             cv::Scalar(205, 200, 198)};
const std::array<const char*, kKinds> kWords{"level, seen from above",
                                             "level, seen from below", "wall", "other"};

Kind kind_of(const SurfaceElement& element) {
  if (element.normal.z > 0.95) return kFromAbove;
  if (element.normal.z < -0.95) return kFromBelow;
  return std::abs(element.normal.z) < 0.3 ? kWall : kOther;
}

/// The level direction along which the recording is widest: the side view shows most of it.
glm::dvec2 widest(const std::vector<SurfaceElement>& elements) {
  glm::dvec2 mean(0.0);
  const auto count = static_cast<double>(elements.size());
  for (const auto& e : elements) mean += glm::dvec2(e.position_m) / count;
  double xx = 0.0, xy = 0.0, yy = 0.0;
  for (const auto& e : elements) {
    const glm::dvec2 d = glm::dvec2(e.position_m) - mean;
    xx += d.x * d.x, xy += d.x * d.y, yy += d.y * d.y;
  }
  const double angle = 0.5 * std::atan2(2.0 * xy, xx - yy);
  return {std::cos(angle), std::sin(angle)};
}

/// Metres to pixels, the same along both axes.
struct Scale {
  double left_m = 0.0, top_m = 0.0, px_per_m = 1.0;

  [[nodiscard]] cv::Point at(double along_m, double height_m) const {
    return {static_cast<int>(std::lround((along_m - left_m) * px_per_m)) + 30, row(height_m)};
  }
  [[nodiscard]] int row(double height_m) const {
    return static_cast<int>(std::lround((top_m - height_m) * px_per_m)) + kTop;
  }
};

struct Extent {
  double low = 1e300, high = -1e300;
  void add(double value) { low = std::min(low, value), high = std::max(high, value); }
};

void draw_floor(cv::Mat& image, const Scale& scale, reconstruction::FloorSource source) {
  using reconstruction::FloorSource;
  const int row = scale.row(0.0);
  const cv::Scalar color = ink::kRecover;
  cv::line(image, {20, row}, {kWidth - 20, row}, color, 1);
  const char* words = source == FloorSource::kFitted    ? "floor"
                      : source == FloorSource::kGuessed ? "floor, guessed"
                      : source == FloorSource::kGiven   ? "floor, given"
                                                        : "the recording's own zero";
  drawing::draw_text(image, words, {24.0, row + 16.0}, kText, color);
}

void draw_heights(cv::Mat& image, const Scale& scale,
                  const std::vector<SurfaceElement>& elements) {
  std::array<std::vector<int>, kKinds> bins;
  const int last = static_cast<int>((image.rows - kTop - kBottom) / scale.px_per_m / kBin_m);
  for (auto& counts : bins) counts.assign(static_cast<std::size_t>(last) + 1, 0);
  int most = 1;
  for (const SurfaceElement& e : elements) {
    const int bin = static_cast<int>((scale.top_m - e.position_m.z) / kBin_m);
    if (bin < 0 || bin > last) continue;
    most = std::max(most, ++bins[kind_of(e)][static_cast<std::size_t>(bin)]);
  }
  for (const Kind kind : {kWall, kFromBelow, kFromAbove}) {
    std::vector<cv::Point> line;
    for (std::size_t bin = 0; bin < bins[kind].size(); ++bin) {
      const double height_m = scale.top_m - (static_cast<double>(bin) + 0.5) * kBin_m;
      line.emplace_back(kScaleX + (kWidth - kScaleX - 20) * bins[kind][bin] / most,
                        scale.row(height_m));
    }
    cv::polylines(image, line, false, kColors[kind], 1, cv::LINE_AA);
  }
}

void draw_legend(cv::Mat& image, const std::string& words) {
  const std::size_t cut = words.find(", floor ");
  const bool two = cut != std::string::npos;
  drawing::draw_text(image, two ? words.substr(0, cut + 1) : words, {20.0, 18.0}, kText,
                     ink::kText);
  if (two) drawing::draw_text(image, words.substr(cut + 2), {20.0, 36.0}, kText, ink::kText);
  double x = 20.0;
  const auto entry = [&](const std::string& text, const cv::Scalar& color) {
    cv::circle(image, {static_cast<int>(x) + 4, image.rows - 12}, 4, color, -1, cv::LINE_AA);
    drawing::draw_text(image, text, {x + 14.0, image.rows - 8.0}, kText, ink::kText);
    x += drawing::text_width_px(text, kText) + 40.0;
  };
  for (std::size_t kind = 0; kind < kKinds; ++kind) entry(kWords[kind], kColors[kind]);
  entry("camera", ink::kNavigate);
}

}  // namespace

core::Image<core::Rgb8> placement_picture(const reconstruction::WorldPlacement& placement,
                                          std::span<const glm::dvec3> camera_positions_m) {
  if (placement.elements.empty()) return {};
  const std::vector<SurfaceElement>& elements = placement.elements;
  const glm::dvec2 side = widest(elements);
  const auto along_m = [&](const glm::dvec3& p) { return glm::dot(side, glm::dvec2(p)); };
  Extent along, heights;
  heights.add(0.0);
  for (const auto& e : elements) along.add(along_m(e.position_m)), heights.add(e.position_m.z);
  for (const glm::dvec3& p : camera_positions_m) {
    along.add(along_m(p)), heights.add(p.z);
  }
  const Scale scale{
      along.low, heights.high,
      std::min((kView - 30.0) / std::max(along.high - along.low, 0.1),
               (kHeight - kTop - kBottom - 24.0) / std::max(heights.high - heights.low, 0.1))};

  const int drawn_px = static_cast<int>((heights.high - heights.low) * scale.px_per_m);
  cv::Mat image(std::max(kTop + drawn_px + 24 + kBottom, 240), kWidth, CV_8UC3, ink::kPaper);
  draw_floor(image, scale, placement.floor_source);
  for (const Kind kind : {kOther, kWall, kFromBelow, kFromAbove}) {
    for (const SurfaceElement& e : elements) {
      if (kind_of(e) != kind) continue;
      const cv::Point at = scale.at(along_m(e.position_m), e.position_m.z);
      cv::circle(image, at, 1, kColors[kind], -1);
    }
  }
  for (const glm::dvec3& p : camera_positions_m) {
    cv::circle(image, scale.at(along_m(p), p.z), 2, ink::kNavigate, -1, cv::LINE_AA);
  }
  draw_heights(image, scale, elements);
  const cv::Point arrow(kView + 20, kTop + 20);
  cv::arrowedLine(image, arrow, {arrow.x, arrow.y + 70}, ink::kText, 2, cv::LINE_AA, 0, 0.2);
  drawing::draw_text(image, "gravity", {kView - 6.0, arrow.y + 90.0}, kText, ink::kText);
  draw_legend(image, reconstruction::describe(placement));
  return drawing::from_bgr(image);
}

}  // namespace segsim::experiments::scenes
