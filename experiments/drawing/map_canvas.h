#pragma once

/// @file
/// Drawing on a floor plan in world coordinates. Everything is drawn twice as large and
/// reduced in the end, which smooths lines and letters.

#include <span>
#include <string>

#include <opencv2/core.hpp>

#include "core/frames.h"
#include "core/scene_bundle.h"
#include "core/stages.h"
#include "experiments/drawing/floor_plan.h"
#include "experiments/drawing/odom_placement.h"
#include "sim/trial/goal_objects.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::drawing {

/// Colours of the pictures, as OpenCV wants them (blue, green, red).
namespace ink {
const cv::Scalar kText(52, 44, 40), kFaint(140, 132, 128), kPaper(248, 250, 250);
const cv::Scalar kInitialize(191, 107, 142), kExplore(196, 116, 30), kNavigate(30, 120, 240);
const cv::Scalar kRecover(50, 40, 210);
const cv::Scalar kGoal(70, 150, 10), kViewPoint(110, 190, 60), kFrontier(0, 190, 245);
const cv::Scalar kDetected(130, 20, 200), kStart(60, 50, 45), kShortest(110, 105, 100);
}  // namespace ink

[[nodiscard]] cv::Scalar mode_color(core::PolicyMode mode);

/// Text with its left end at `at` and its baseline there. @param height_px  Of capital
/// letters.
void draw_text(cv::Mat& image, const std::string& text, const cv::Point2d& at,
               double height_px, const cv::Scalar& color, bool bold = false);
[[nodiscard]] double text_width_px(const std::string& text, double height_px,
                                   bool bold = false);

/// RGB image to OpenCV's order and back.
[[nodiscard]] cv::Mat to_bgr(const core::Image<core::Rgb8>& image);
[[nodiscard]] core::Image<core::Rgb8> from_bgr(const cv::Mat& image);
/// A file in memory. @param ending  ".jpg" or ".png".  @param jpeg_quality  1 ... 100.
[[nodiscard]] std::string encoded(const cv::Mat& bgr, const char* ending, int jpeg_quality);

class MapCanvas {
 public:
  /// @param scale  Canvas pixels per pixel of the plan.
  MapCanvas(const FloorPlan& plan, double scale);
  /// With pixels of its own: a copy draws on those of the first.
  [[nodiscard]] MapCanvas clone() const;

  /// Where the frame of the views to come lies; without it they are taken for World's.
  void place_views(const OdomPlacement& placement) { view_ = placement; }

  /// Fades what the policy does not know and marks what it holds for an obstacle.
  void draw_knowledge(const core::PolicyView& view);
  void draw_frontiers(const core::PolicyView& view);
  /// Goal instances as outlined boxes.
  void draw_goals(const core::SceneManifest& manifest, const sim::GoalObjects& goal);
  void draw_view_points(std::span<const glm::dvec2> view_points_m);
  void draw_shortest_path(std::span<const glm::dvec2> path_m);
  /// The driven path, each piece in the colour of its mode; a cross at each contact.
  void draw_track(std::span<const sim::TickRecord> track);
  void draw_start(const core::Pose2& pose);
  void draw_robot(const core::Pose2& pose, double hfov_rad);
  /// Objects of the policy's own map: those of the goal class large.
  void draw_objects(const core::PolicyView& view, int goal_index);
  /// A short text on a disc, above the place.
  void draw_mark(const glm::dvec2& p_m, const std::string& text);
  void draw_target(const core::PolicyView& view);
  /// One metre, in the lower left corner.
  void draw_scale_bar();

  [[nodiscard]] cv::Mat& image() { return image_; }

 private:
  [[nodiscard]] cv::Point2d px(const glm::dvec2& p_m) const;
  [[nodiscard]] double length_px(double length_m) const { return length_m * px_per_m_; }
  void line(const glm::dvec2& a_m, const glm::dvec2& b_m, const cv::Scalar& color,
            double width_px);
  void disc(const glm::dvec2& p_m, double radius_px, const cv::Scalar& fill,
            const cv::Scalar& rim);

  cv::Mat image_;
  OdomPlacement view_;
  glm::dvec2 origin_m_;
  double px_per_m_;
  double unit_;  ///< Width of a thin line [canvas pixels].
};

}  // namespace segsim::experiments::drawing
