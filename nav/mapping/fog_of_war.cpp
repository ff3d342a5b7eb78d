#include "nav/mapping/fog_of_war.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/frames.h"

namespace segsim::nav {
namespace {

using Outline = std::vector<cv::Point>;

/// The two points of the outline that are seen farthest apart from `eye`.
std::array<cv::Point, 2> extreme_bearings(const Outline& outline, const cv::Point& eye) {
  const auto bearing = [&](const cv::Point& p) {
    return std::atan2(p.y - eye.y, p.x - eye.x);
  };
  // Relative to the first point, so that the cut of atan2 does not matter.
  const double reference = bearing(outline.front());
  const auto less = [&](const cv::Point& a, const cv::Point& b) {
    return core::wrap_angle_rad(bearing(a) - reference) <
           core::wrap_angle_rad(bearing(b) - reference);
  };
  const auto [low, high] = std::minmax_element(outline.begin(), outline.end(), less);
  return {*low, *high};
}

/// Draws the shadow line that begins at `from`, away from the eye.
void cut_behind(cv::Mat& mask, const cv::Point& eye, const cv::Point& from,
                double length_cells, int thickness) {
  const double dx = from.x - eye.x, dy = from.y - eye.y, norm = std::hypot(dx, dy);
  if (norm <= 0.0) return;
  const cv::Point to(from.x + static_cast<int>(std::lround(dx / norm * length_cells)),
                     from.y + static_cast<int>(std::lround(dy / norm * length_cells)));
  cv::line(mask, from, to, cv::Scalar(0), thickness);
}

std::vector<Outline> outlines_of(const cv::Mat& mask) {
  std::vector<Outline> outlines;
  cv::findContours(mask, outlines, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_SIMPLE);
  return outlines;
}

}  // namespace

CellWindow revealed_cells(const GridFrame& frame, const GridView<std::uint8_t>& navigable,
                          const glm::dvec2& position_m, double yaw_rad,
                          const FogOptions& options, const VlfmRules& rules) {
  const int radius = static_cast<int>(options.range_m / frame.resolution_m);
  const int side = 2 * radius + 3;
  const Cell robot = frame.cell_at(position_m);
  CellWindow window{{robot.x - radius - 1, robot.y - radius - 1},
                    core::Image<std::uint8_t>(side, side)};
  const cv::Point eye(radius + 1, radius + 1);

  // The sector, and the obstacles in it. Off the map nothing is revealed.
  cv::Mat sector(side, side, CV_8U, cv::Scalar(0));
  const double yaw_deg = yaw_rad * 180.0 / std::numbers::pi;
  const double half_deg = 0.5 * options.hfov_rad * 180.0 / std::numbers::pi;
  cv::ellipse(sector, eye, {radius, radius}, 0.0, yaw_deg - half_deg, yaw_deg + half_deg,
              cv::Scalar(1), cv::FILLED);
  cv::Mat free(side, side, CV_8U, cv::Scalar(0));
  const int i0 = std::max(0, -window.low.x), j0 = std::max(0, -window.low.y);
  const int i1 = std::min(side, frame.width_cells - window.low.x);
  const int j1 = std::min(side, frame.height_cells - window.low.y);
  for (int j = j0; j < j1; ++j) {
    if (i0 < i1) {
      std::copy_n(navigable.row(j + window.low.y) + window.low.x + i0, i1 - i0,
                  free.ptr<std::uint8_t>(j) + i0);
    }
  }
  const cv::Mat obstacles = sector & (free == 0);
  cv::Mat visible = sector & free;
  cv::Mat revealed(side, side, CV_8U, window.cells.data());

  const std::vector<Outline> hiding = outlines_of(obstacles);
  if (hiding.empty()) {
    if (!rules.published(Quirk::kEmptyCone)) visible.copyTo(revealed);
    return window;
  }
  const double cut_cells = options.overshoot * radius;
  for (const Outline& outline : hiding) {
    if (cv::isContourConvex(outline)) {
      for (const cv::Point& point : extreme_bearings(outline, eye)) {
        cut_behind(visible, eye, point, cut_cells, options.cut_thickness_cells);
      }
    } else {
      for (const cv::Point& point : outline) {
        cut_behind(visible, eye, point, cut_cells, options.cut_thickness_cells);
      }
    }
  }
  const std::vector<Outline> pieces = outlines_of(visible);
  std::size_t best = pieces.size();
  double best_cells = 1e18;
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    const double distance = std::abs(cv::pointPolygonTest(
        pieces[k], {static_cast<float>(eye.x), static_cast<float>(eye.y)}, true));
    if (distance < best_cells) {
      best_cells = distance;
      best = k;
    }
  }
  if (best == pieces.size() || best_cells > options.max_gap_cells) return window;
  cv::drawContours(revealed, pieces, static_cast<int>(best), cv::Scalar(1), cv::FILLED);
  return window;
}

}  // namespace segsim::nav
