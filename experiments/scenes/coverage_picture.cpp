#include <algorithm>
#include <cmath>
#include <string>

#include <opencv2/imgproc.hpp>

#include "core/formatted.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/scenes/coverage_guide.h"

namespace segsim::experiments::scenes {
namespace {

constexpr int kScale = 2;  // Canvas pixels per pixel of the plan; reduced in the end.
constexpr int kCaption_px = 34;
constexpr double kLetter_px = 9.0, kArrow_m = 0.7, kDisc_m = 0.11;
constexpr double kBad = 0.5;  // Share of missing pixels that is drawn in full red.

/// Green, yellow, red, in OpenCV's order.
cv::Scalar badness_color(double missing) {
  const double t = std::clamp(missing / kBad, 0.0, 1.0);
  return {60.0, 60.0 + 140.0 * std::min(1.0, 2.0 - 2.0 * t),
          60.0 + 160.0 * std::min(1.0, 2.0 * t)};
}

}  // namespace

core::Image<core::Rgb8> coverage_picture(const drawing::FloorPlan& plan,
                                         const CoverageGuide& guide) {
  cv::Mat canvas;
  cv::resize(drawing::to_bgr(plan.rgb), canvas, {}, kScale, kScale, cv::INTER_LINEAR);
  const auto at = [&](const glm::dvec2& p_m) {
    const glm::dvec2 px = plan.to_px(p_m);
    return cv::Point(static_cast<int>(std::lround(kScale * px.x)),
                     static_cast<int>(std::lround(kScale * px.y)));
  };
  const double m = kScale * plan.px_per_m;
  for (const CoveragePlace& place : guide.places) {
    cv::circle(canvas, at(place.p_m), std::max(2, static_cast<int>(kDisc_m * m)),
               badness_color(place.missing), cv::FILLED, cv::LINE_AA);
  }
  for (std::size_t i = 0; i < guide.poses.size(); ++i) {
    const core::Pose2& pose = guide.poses[i].pose;
    const glm::dvec2 from_m(pose.x_m, pose.y_m);
    const glm::dvec2 to_m =
        from_m + kArrow_m * glm::dvec2(std::cos(pose.yaw_rad), std::sin(pose.yaw_rad));
    cv::arrowedLine(canvas, at(from_m), at(to_m), drawing::ink::kRecover, 2 * kScale,
                    cv::LINE_AA, 0, 0.3);
    const cv::Point number = at(from_m);
    cv::circle(canvas, number, static_cast<int>(kScale * 1.1 * kLetter_px),
               drawing::ink::kPaper, cv::FILLED, cv::LINE_AA);
    const std::string text = std::to_string(i + 1);
    drawing::draw_text(
        canvas, text,
        {number.x - 0.5 * drawing::text_width_px(text, kScale * kLetter_px, true),
         number.y + 0.5 * kScale * kLetter_px},
        kScale * kLetter_px, drawing::ink::kText, true);
  }
  cv::Mat small;
  cv::resize(canvas, small, {plan.rgb.width_px(), plan.rgb.height_px()}, 0, 0, cv::INTER_AREA);
  cv::Mat sheet;
  cv::copyMakeBorder(small, sheet, 0, kCaption_px, 0, 0, cv::BORDER_CONSTANT,
                     drawing::ink::kPaper);
  drawing::draw_text(
      sheet,
      core::print("camera %.2f m high: %.1f %% missing; arrows: frames that help most",
                  guide.camera_height_m, 100.0 * guide.missing),
      {8.0, sheet.rows - 0.5 * (kCaption_px - kLetter_px)}, kLetter_px, drawing::ink::kText);
  return drawing::from_bgr(sheet);
}

}  // namespace segsim::experiments::scenes
