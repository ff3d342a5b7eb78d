#include "experiments/drawing/map_canvas.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/check.h"

namespace segsim::experiments::drawing {
namespace {

constexpr int kShift = 4;  // Fixed-point bits of OpenCV's sub-pixel coordinates.

cv::Point fixed(const cv::Point2d& p) {
  return {static_cast<int>(std::lround(p.x * (1 << kShift))),
          static_cast<int>(std::lround(p.y * (1 << kShift)))};
}

int thickness(double width_px) { return std::max(1, static_cast<int>(std::lround(width_px))); }

int font(bool bold) { return bold ? cv::FONT_HERSHEY_DUPLEX : cv::FONT_HERSHEY_SIMPLEX; }

/// A filled shape with a see-through inside.
void fill_polygon(cv::Mat& image, const std::vector<cv::Point>& corners,
                  const cv::Scalar& color, double opacity) {
  const cv::Rect bounds = cv::boundingRect(corners);
  const cv::Point first(bounds.x >> kShift, bounds.y >> kShift);
  const cv::Point last((bounds.x + bounds.width) >> kShift,
                       (bounds.y + bounds.height) >> kShift);
  constexpr int kSoftEdge_px = 2;
  const cv::Rect part = cv::Rect(first.x - kSoftEdge_px, first.y - kSoftEdge_px,
                                 last.x - first.x + 2 * kSoftEdge_px + 1,
                                 last.y - first.y + 2 * kSoftEdge_px + 1) &
                        cv::Rect(cv::Point(), image.size());
  if (part.empty()) return;
  cv::Mat under = image(part), layer = under.clone();
  const std::vector<std::vector<cv::Point>> polygons{corners};
  cv::fillPoly(layer, polygons, color, cv::LINE_AA, kShift, -part.tl() * (1 << kShift));
  cv::addWeighted(layer, opacity, under, 1.0 - opacity, 0.0, under);
}

}  // namespace

cv::Scalar mode_color(core::PolicyMode mode) {
  switch (mode) {
    case core::PolicyMode::kInitialize:
      return ink::kInitialize;
    case core::PolicyMode::kExplore:
      return ink::kExplore;
    case core::PolicyMode::kNavigate:
    case core::PolicyMode::kStop:
      return ink::kNavigate;
    case core::PolicyMode::kRecover:
      return ink::kRecover;
  }
  return ink::kText;
}

void draw_text(cv::Mat& image, const std::string& text, const cv::Point2d& at,
               double height_px, const cv::Scalar& color, bool bold) {
  const int width = thickness(height_px / (bold ? 9.0 : 11.0));
  const double scale = cv::getFontScaleFromHeight(font(bold), thickness(height_px), width);
  cv::putText(image, text, cv::Point(static_cast<int>(at.x), static_cast<int>(at.y)),
              font(bold), scale, color, width, cv::LINE_AA);
}

double text_width_px(const std::string& text, double height_px, bool bold) {
  const int width = thickness(height_px / (bold ? 9.0 : 11.0));
  const double scale = cv::getFontScaleFromHeight(font(bold), thickness(height_px), width);
  int baseline = 0;
  return cv::getTextSize(text, font(bold), scale, width, &baseline).width;
}

cv::Mat to_bgr(const core::Image<core::Rgb8>& image) {
  cv::Mat bgr(image.height_px(), image.width_px(), CV_8UC3);
  for (int y = 0; y < image.height_px(); ++y) {
    const core::Rgb8* from = image.row(y);
    cv::Vec3b* to = bgr.ptr<cv::Vec3b>(y);
    for (int x = 0; x < image.width_px(); ++x) to[x] = {from[x].b, from[x].g, from[x].r};
  }
  return bgr;
}

std::string encoded(const cv::Mat& bgr, const char* ending, int jpeg_quality) {
  std::vector<unsigned char> bytes;
  SEGSIM_CHECK(cv::imencode(ending, bgr, bytes, {cv::IMWRITE_JPEG_QUALITY, jpeg_quality}),
               ending);
  return {bytes.begin(), bytes.end()};
}

core::Image<core::Rgb8> from_bgr(const cv::Mat& bgr) {
  core::Image<core::Rgb8> image(bgr.cols, bgr.rows);
  for (int y = 0; y < bgr.rows; ++y) {
    const cv::Vec3b* from = bgr.ptr<cv::Vec3b>(y);
    core::Rgb8* to = image.row(y);
    for (int x = 0; x < bgr.cols; ++x) to[x] = {from[x][2], from[x][1], from[x][0]};
  }
  return image;
}

MapCanvas::MapCanvas(const FloorPlan& plan, double scale)
    : origin_m_(plan.origin_m), px_per_m_(plan.px_per_m * scale) {
  const cv::Mat plan_bgr = to_bgr(plan.rgb);
  const int method = scale < 1.0 ? cv::INTER_AREA : cv::INTER_CUBIC;
  cv::resize(plan_bgr, image_, cv::Size(), scale, scale, method);
  unit_ = std::max(1.0, 0.022 * px_per_m_);
}

MapCanvas MapCanvas::clone() const {
  MapCanvas other = *this;
  other.image_ = image_.clone();
  return other;
}

cv::Point2d MapCanvas::px(const glm::dvec2& p_m) const {
  return {(p_m.x - origin_m_.x) * px_per_m_, image_.rows - (p_m.y - origin_m_.y) * px_per_m_};
}

void MapCanvas::line(const glm::dvec2& a_m, const glm::dvec2& b_m, const cv::Scalar& color,
                     double width_px) {
  cv::line(image_, fixed(px(a_m)), fixed(px(b_m)), color, thickness(width_px), cv::LINE_AA,
           kShift);
}

void MapCanvas::disc(const glm::dvec2& p_m, double radius_px, const cv::Scalar& fill,
                     const cv::Scalar& rim) {
  const int radius = static_cast<int>(std::lround(radius_px * (1 << kShift)));
  cv::circle(image_, fixed(px(p_m)), radius, fill, cv::FILLED, cv::LINE_AA, kShift);
  cv::circle(image_, fixed(px(p_m)), radius, rim, thickness(0.4 * unit_), cv::LINE_AA, kShift);
}

namespace {

/// What becomes of a channel's 256 values under a cell of the policy's map: unknown (0) fades
/// to fog, obstacles (2) get a red shade, free cells stay.
class KnowledgeShade {
 public:
  KnowledgeShade() {
    for (std::size_t cell = 0; cell < kCells; ++cell) {
      const double keep = cell == 0 ? 0.30 : (cell == 2 ? 0.55 : 1.0);
      const cv::Vec3d other = cell == 0 ? cv::Vec3d(222, 220, 217) : cv::Vec3d(70, 60, 150);
      for (std::size_t value = 0; value < 256; ++value) {
        for (int c = 0; c < 3; ++c) {
          table_[cell][value][c] = static_cast<std::uint8_t>(
              std::lround(keep * static_cast<double>(value) + (1.0 - keep) * other[c]));
        }
      }
    }
  }
  void apply(std::uint8_t cell, cv::Vec3b& pixel) const {
    const auto& values = table_[std::min<std::size_t>(cell, kCells - 1)];
    for (int c = 0; c < 3; ++c) pixel[c] = values[pixel[c]][c];
  }

 private:
  static constexpr std::size_t kCells = 4;  ///< The last one stands for all above it.
  std::array<std::array<cv::Vec3b, 256>, kCells> table_;
};

}  // namespace

void MapCanvas::draw_knowledge(const core::PolicyView& view) {
  static const KnowledgeShade kShade;
  if (view.cells.empty()) return;
  const auto cell_at = [&](double x_m, double y_m) {
    return (view_.to_odom({x_m, y_m}) - view.origin_m) / view.resolution_m;
  };
  // Cells of neighbouring pixels lie a constant step apart.
  const glm::dvec2 step = (cell_at(1.0, 0.0) - cell_at(0.0, 0.0)) / px_per_m_;
  for (int y = 0; y < image_.rows; ++y) {
    cv::Vec3b* row = image_.ptr<cv::Vec3b>(y);
    const glm::dvec2 first = cell_at(origin_m_.x + 0.5 / px_per_m_,
                                     origin_m_.y + (image_.rows - (y + 0.5)) / px_per_m_);
    for (int x = 0; x < image_.cols; ++x) {
      const glm::dvec2 at = first + static_cast<double>(x) * step;
      const int i = at.x < 0.0 ? -1 : static_cast<int>(at.x);
      const int j = at.y < 0.0 ? -1 : static_cast<int>(at.y);
      kShade.apply(view.cells.contains(i, j) ? view.cells(i, j) : std::uint8_t{0}, row[x]);
    }
  }
}

void MapCanvas::draw_frontiers(const core::PolicyView& view) {
  for (const glm::dvec2& p : view.frontiers_m) {
    disc(view_.to_world(p), 3.2 * unit_, ink::kFrontier, cv::Scalar(0, 110, 150));
  }
}

void MapCanvas::draw_goals(const core::SceneManifest& manifest, const sim::GoalObjects& goal) {
  for (const core::SceneInstance& instance : manifest.instances) {
    if (!goal.holds(instance)) continue;
    const cv::Point2d a = px({instance.box_min_m.x, instance.box_max_m.y});
    const cv::Point2d b = px({instance.box_max_m.x, instance.box_min_m.y});
    const std::vector<cv::Point> corners{fixed(a), fixed({b.x, a.y}), fixed(b),
                                         fixed({a.x, b.y})};
    fill_polygon(image_, corners, ink::kGoal, 0.28);
    const std::vector<std::vector<cv::Point>> outline{corners};
    cv::polylines(image_, outline, true, ink::kGoal, thickness(1.6 * unit_), cv::LINE_AA,
                  kShift);
  }
}

void MapCanvas::draw_view_points(std::span<const glm::dvec2> view_points_m) {
  for (const glm::dvec2& p : view_points_m) {
    cv::circle(image_, fixed(px(p)), static_cast<int>(1.5 * unit_ * (1 << kShift)),
               ink::kViewPoint, cv::FILLED, cv::LINE_AA, kShift);
  }
}

void MapCanvas::draw_shortest_path(std::span<const glm::dvec2> path_m) {
  const double dash_m = 0.12;
  double along_m = 0.0;
  for (std::size_t k = 1; k < path_m.size(); ++k) {
    const glm::dvec2 step = path_m[k] - path_m[k - 1];
    const double length_m = std::hypot(step.x, step.y);
    for (double s_m = 0.0; s_m < length_m;) {
      const double phase = std::fmod(along_m + s_m, 2.0 * dash_m);
      const bool drawn = phase < dash_m;
      const double rest_m = (drawn ? dash_m : 2.0 * dash_m) - phase + 1e-6;
      const double end_m = std::min(length_m, s_m + rest_m);
      if (drawn) {
        line(path_m[k - 1] + step * (s_m / length_m),
             path_m[k - 1] + step * (end_m / length_m), ink::kShortest, 1.3 * unit_);
      }
      s_m = end_m;
    }
    along_m += length_m;
  }
}

void MapCanvas::draw_track(std::span<const sim::TickRecord> track) {
  // A pale rim first keeps the path readable on dark floors.
  for (const bool rim : {true, false}) {
    for (std::size_t k = 1; k < track.size(); ++k) {
      const core::Pose2 &a = track[k - 1].pose, &b = track[k].pose;
      line({a.x_m, a.y_m}, {b.x_m, b.y_m}, rim ? ink::kPaper : mode_color(track[k].mode),
           (rim ? 4.4 : 2.6) * unit_);
    }
  }
  for (std::size_t k = 1; k < track.size(); ++k) {
    if (!track[k].in_contact || track[k - 1].in_contact) continue;
    const glm::dvec2 p{track[k].pose.x_m, track[k].pose.y_m};
    const double arm_m = 5.0 * unit_ / px_per_m_;
    line(p + glm::dvec2(-arm_m, -arm_m), p + glm::dvec2(arm_m, arm_m), ink::kRecover,
         1.6 * unit_);
    line(p + glm::dvec2(-arm_m, arm_m), p + glm::dvec2(arm_m, -arm_m), ink::kRecover,
         1.6 * unit_);
  }
}

void MapCanvas::draw_start(const core::Pose2& pose) {
  disc({pose.x_m, pose.y_m}, 5.5 * unit_, ink::kPaper, ink::kStart);
  disc({pose.x_m, pose.y_m}, 2.8 * unit_, ink::kStart, ink::kStart);
}

void MapCanvas::draw_mark(const glm::dvec2& p_m, const std::string& text) {
  const double letter_px = 6.0 * unit_;
  const cv::Point2d foot = px(p_m), head(foot.x, foot.y - 16.0 * unit_);
  cv::line(image_, foot, head, ink::kText, std::max(1, static_cast<int>(unit_)), cv::LINE_AA);
  cv::circle(image_, head, static_cast<int>(7.5 * unit_), ink::kText, cv::FILLED, cv::LINE_AA);
  draw_text(image_, text,
            {head.x - 0.5 * text_width_px(text, letter_px, true), head.y + 0.5 * letter_px},
            letter_px, ink::kPaper, true);
}

void MapCanvas::draw_robot(const core::Pose2& pose, double hfov_rad) {
  const auto at = [&](double forward_m, double left_m) {
    const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
    return fixed(
        px({pose.x_m + c * forward_m - s * left_m, pose.y_m + s * forward_m + c * left_m}));
  };
  if (hfov_rad > 0.0) {
    const double reach_m = 1.3, half = 0.5 * hfov_rad;
    std::vector<cv::Point> cone{at(0.0, 0.0)};
    for (int k = -6; k <= 6; ++k) {
      const double angle = half * k / 6.0;
      cone.push_back(at(reach_m * std::cos(angle), reach_m * std::sin(angle)));
    }
    fill_polygon(image_, cone, ink::kNavigate, 0.25);
  }
  const std::vector<std::vector<cv::Point>> body{
      {at(0.32, 0.0), at(-0.22, 0.22), at(-0.10, 0.0), at(-0.22, -0.22)}};
  cv::fillPoly(image_, body, ink::kStart, cv::LINE_AA, kShift);
  cv::polylines(image_, body, true, ink::kPaper, thickness(unit_), cv::LINE_AA, kShift);
}

void MapCanvas::draw_objects(const core::PolicyView& view, int goal_index) {
  for (const core::PolicyView::Object& object : view.objects) {
    const bool goal = object.class_index == goal_index;
    const double r_m = (goal ? 6.5 : 3.0) * unit_ / px_per_m_;
    const glm::dvec2 p_m = view_.to_world(object.position_m);
    const std::vector<std::vector<cv::Point>> diamond{
        {fixed(px(p_m + glm::dvec2(r_m, 0.0))), fixed(px(p_m + glm::dvec2(0.0, r_m))),
         fixed(px(p_m - glm::dvec2(r_m, 0.0))), fixed(px(p_m - glm::dvec2(0.0, r_m)))}};
    cv::fillPoly(image_, diamond, goal ? ink::kDetected : ink::kFaint, cv::LINE_AA, kShift);
    cv::polylines(image_, diamond, true, ink::kPaper, thickness(0.8 * unit_), cv::LINE_AA,
                  kShift);
  }
}

void MapCanvas::draw_target(const core::PolicyView& view) {
  for (std::size_t k = 1; k < view.path_m.size(); ++k) {
    line(view_.to_world(view.path_m[k - 1]), view_.to_world(view.path_m[k]), ink::kFaint,
         unit_);
  }
  if (!view.target_m) return;
  cv::circle(image_, fixed(px(view_.to_world(*view.target_m))),
             static_cast<int>(5.0 * unit_ * (1 << kShift)), ink::kDetected,
             thickness(1.3 * unit_), cv::LINE_AA, kShift);
}

void MapCanvas::draw_scale_bar() {
  const double margin_px = 8.0 * unit_, y = image_.rows - margin_px;
  const cv::Point2d a{margin_px, y}, b{margin_px + length_px(1.0), y};
  const double tick_px = 3.0 * unit_;
  for (const bool rim : {true, false}) {
    const cv::Scalar color = rim ? ink::kPaper : ink::kText;
    const int width = thickness((rim ? 3.6 : 1.4) * unit_);
    cv::line(image_, fixed(a), fixed(b), color, width, cv::LINE_AA, kShift);
    for (const cv::Point2d& end : {a, b}) {
      cv::line(image_, fixed({end.x, end.y - tick_px}), fixed({end.x, end.y + tick_px}), color,
               width, cv::LINE_AA, kShift);
    }
  }
  draw_text(image_, "1 m", {a.x + 3.0 * unit_, y - 4.0 * unit_}, 6.5 * unit_, ink::kText);
}

}  // namespace segsim::experiments::drawing
