#include "experiments/drawing/recording_plan.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <opencv2/imgproc.hpp>

#include "core/formatted.h"
#include "experiments/drawing/map_canvas.h"

namespace segsim::experiments::drawing {
namespace {

constexpr int kSide_px = 1000, kMargin_px = 30, kHeader_px = 60, kRose_px = 170;
constexpr double kView_m = 2.0;  ///< How far a camera's view is drawn.
constexpr std::size_t kMostViews = 600;
constexpr double kAbove_m = 0.5, kBelow_m = 1.0;  ///< Walls and furniture, about the cameras.
const cv::Scalar kLooked(150, 200, 120), kUnseen(50, 40, 210), kSeen(150, 110, 60);

/// Which part of the world the picture shows.
struct Extent {
  glm::dvec2 min_m{0.0}, max_m{0.0};
  double px_per_m = 1.0;

  [[nodiscard]] cv::Size size_px() const {
    return {static_cast<int>((max_m.x - min_m.x) * px_per_m) + 1,
            static_cast<int>((max_m.y - min_m.y) * px_per_m) + 1};
  }
  [[nodiscard]] cv::Point px(const glm::dvec2& p_m) const {
    return {static_cast<int>(std::lround((p_m.x - min_m.x) * px_per_m)),
            static_cast<int>(std::lround((max_m.y - p_m.y) * px_per_m))};
  }
};

/// All but the outermost 2 % of values on each side.
void most_of(std::vector<double> values, double& lowest, double& highest) {
  std::sort(values.begin(), values.end());
  const std::size_t cut = values.size() / 50;
  lowest = std::min(lowest, values[cut]);
  highest = std::max(highest, values[values.size() - 1 - cut]);
}

Extent extent_of(const RecordingPlan& plan) {
  Extent extent{glm::dvec2(1e9), glm::dvec2(-1e9), 1.0};
  for (const core::CameraPose& pose : plan.path) {
    const glm::dvec2 p_m(pose.translation_m());
    extent.min_m = glm::min(extent.min_m, p_m), extent.max_m = glm::max(extent.max_m, p_m);
  }
  for (const int axis : {0, 1}) {
    if (plan.points_m.empty()) break;
    std::vector<double> values;
    for (const glm::vec3& p_m : plan.points_m) values.push_back(p_m[axis]);
    most_of(std::move(values), extent.min_m[axis], extent.max_m[axis]);
  }
  extent.min_m -= glm::dvec2(0.5), extent.max_m += glm::dvec2(0.5);
  const glm::dvec2 size_m = extent.max_m - extent.min_m;
  extent.px_per_m = kSide_px / std::max(size_m.x, size_m.y);
  return extent;
}

double middle_height_m(const RecordingPlan& plan) {
  std::vector<double> heights_m;
  for (const core::CameraPose& pose : plan.path) heights_m.push_back(pose.translation_m().z);
  const auto middle = heights_m.begin() + static_cast<std::ptrdiff_t>(heights_m.size() / 2);
  std::nth_element(heights_m.begin(), middle, heights_m.end());
  return *middle;
}

/// Yaw of the optical axis; false for a camera that looks straight up or down.
bool yaw_of(const core::CameraPose& pose, double& yaw_rad) {
  const glm::dvec3 forward = pose.rotation() * glm::dvec3(0.0, 0.0, 1.0);
  yaw_rad = std::atan2(forward.y, forward.x);
  return std::hypot(forward.x, forward.y) > 0.3;
}

/// Blends `color` into the map by `share`, 8 bit, of each pixel.
void tint(cv::Mat& map, const cv::Mat& share, const cv::Scalar& color) {
  for (int y = 0; y < map.rows; ++y) {
    for (int x = 0; x < map.cols; ++x) {
      const double s = share.at<std::uint8_t>(y, x) / 255.0;
      auto& pixel = map.at<cv::Vec3b>(y, x);
      for (int c = 0; c < 3; ++c) {
        pixel[c] = cv::saturate_cast<std::uint8_t>((1.0 - s) * pixel[c] + s * color[c]);
      }
    }
  }
}

void draw_views(cv::Mat& map, const RecordingPlan& plan, const Extent& extent) {
  cv::Mat looked(map.size(), CV_16U, cv::Scalar(0)), one(map.size(), CV_16U);
  const std::size_t step = plan.path.size() / kMostViews + 1;
  for (std::size_t i = 0; i < plan.path.size(); i += step) {
    double yaw_rad = 0.0;
    if (!yaw_of(plan.path[i], yaw_rad)) continue;
    const glm::dvec2 eye_m(plan.path[i].translation_m());
    std::vector<cv::Point> wedge{extent.px(eye_m)};
    for (int k = -4; k <= 4; ++k) {
      const double a = yaw_rad + k / 8.0 * plan.horizontal_fov_rad;
      wedge.push_back(extent.px(eye_m + kView_m * glm::dvec2(std::cos(a), std::sin(a))));
    }
    const cv::Rect around = cv::boundingRect(wedge) & cv::Rect({0, 0}, map.size());
    if (around.empty()) continue;
    one(around).setTo(0);
    cv::fillConvexPoly(one, wedge, cv::Scalar(1));
    looked(around) += one(around);
  }
  cv::Mat share;
  // A dozen views are many: from there on the colour is full.
  looked.convertTo(share, CV_8U, 160.0 / 12.0);
  tint(map, cv::min(share, 160), kLooked);
}

void draw_points(cv::Mat& map, const RecordingPlan& plan, const Extent& extent) {
  const double middle_m = middle_height_m(plan);
  cv::Mat hits(map.size(), CV_8U, cv::Scalar(0));
  for (const glm::vec3& p_m : plan.points_m) {
    if (p_m.z < middle_m - kBelow_m || p_m.z > middle_m + kAbove_m) continue;
    const cv::Point px = extent.px(glm::dvec2(p_m));
    if (!cv::Rect({0, 0}, map.size()).contains(px)) continue;
    auto& hit = hits.at<std::uint8_t>(px);
    hit = cv::saturate_cast<std::uint8_t>(hit + 90);
  }
  tint(map, hits, ink::kText);
}

/// From blue at the start to red at the end.
cv::Scalar time_color(double share) {
  return {220.0 * (1.0 - share) + 30.0 * share, 90.0, 30.0 * (1.0 - share) + 220.0 * share};
}

void draw_path(cv::Mat& map, const RecordingPlan& plan, const Extent& extent) {
  const auto at = [&](std::size_t i) {
    return extent.px(glm::dvec2(plan.path[i].translation_m()));
  };
  for (std::size_t i = 0; i + 1 < plan.path.size(); ++i) {
    const double share = static_cast<double>(i) / static_cast<double>(plan.path.size());
    cv::line(map, at(i), at(i + 1), time_color(share), 2, cv::LINE_AA);
  }
  const std::size_t step = plan.path.size() / 60 + 1;
  for (std::size_t i = 0; i < plan.path.size(); i += step) {
    double yaw_rad = 0.0;
    if (!yaw_of(plan.path[i], yaw_rad)) continue;
    const cv::Point arrow(static_cast<int>(18 * std::cos(yaw_rad)),
                          static_cast<int>(-18 * std::sin(yaw_rad)));
    cv::arrowedLine(map, at(i), at(i) + arrow,
                    time_color(static_cast<double>(i) / static_cast<double>(plan.path.size())),
                    1, cv::LINE_AA, 0, 0.35);
  }
  for (const std::size_t i : plan.marked) {
    cv::drawMarker(map, at(i), kUnseen, cv::MARKER_TILTED_CROSS, 12, 2, cv::LINE_AA);
  }
}

void draw_scale(cv::Mat& map, const Extent& extent) {
  const cv::Point left(12, map.rows - 14);
  const int metre_px = static_cast<int>(std::lround(extent.px_per_m));
  cv::line(map, left, left + cv::Point(metre_px, 0), ink::kText, 3);
  draw_text(map, "1 m", left + cv::Point(0, -8), 10.0, ink::kText);
}

void draw_rose(cv::Mat& page, const cv::Point& center, const RecordingPlan& plan) {
  const int most =
      *std::max_element(plan.frames_of_sector.begin(), plan.frames_of_sector.end());
  const double sector_deg = 360.0 / static_cast<double>(plan.frames_of_sector.size());
  constexpr double kRadius_px = 0.4 * kRose_px;
  for (std::size_t i = 0; i < plan.frames_of_sector.size(); ++i) {
    const int frames = plan.frames_of_sector[i];
    const double share = most > 0 ? static_cast<double>(frames) / most : 0.0;
    const int radius_px = static_cast<int>(
        frames == 0 ? kRadius_px : kRadius_px * (0.15 + 0.85 * std::sqrt(share)));
    // OpenCV's angles go clockwise.
    const double from_deg = -static_cast<double>(i) * sector_deg;
    cv::ellipse(page, center, {radius_px, radius_px}, 0.0, from_deg - sector_deg + 0.5,
                from_deg - 0.5, frames == 0 ? kUnseen : kSeen, frames == 0 ? 2 : cv::FILLED,
                cv::LINE_AA);
  }
}

}  // namespace

core::Image<core::Rgb8> draw_recording_plan(const RecordingPlan& plan) {
  const Extent extent = extent_of(plan);
  cv::Mat map(extent.size_px(), CV_8UC3, ink::kPaper);
  draw_views(map, plan, extent);
  draw_points(map, plan, extent);
  draw_path(map, plan, extent);
  draw_scale(map, extent);
  const int width_px = std::max(map.cols, 640) + kRose_px + 2 * kMargin_px;
  const int height_px = std::max(map.rows, kRose_px + 60) + kHeader_px + kMargin_px;
  cv::Mat page(height_px, width_px, CV_8UC3, cv::Scalar(255, 255, 255));
  map.copyTo(page(cv::Rect({kMargin_px, kHeader_px}, map.size())));
  draw_text(page, plan.title, {kMargin_px, 28.0}, 13.0, ink::kText, true);
  draw_text(page,
            "green: looked over; grey: measured near camera height; path: blue to red; "
            "crosses: blurred",
            {kMargin_px, 48.0}, 9.0, ink::kFaint);
  const cv::Point rose(width_px - kMargin_px - kRose_px / 2, kHeader_px + kRose_px / 2);
  if (!plan.frames_of_sector.empty()) {
    draw_rose(page, rose, plan);
    draw_text(page, "frames by yaw; red: none", {rose.x - 0.5 * kRose_px, rose.y + 95.0}, 8.0,
              ink::kFaint);
  }
  return from_bgr(page);
}

}  // namespace segsim::experiments::drawing
