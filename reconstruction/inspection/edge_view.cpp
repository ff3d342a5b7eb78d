#include "reconstruction/inspection/edge_view.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <glm/geometric.hpp>
#include <opencv2/imgproc.hpp>

#include "reconstruction/inspection/internal/edge_maps.h"
#include "reconstruction/inspection/internal/grey_image.h"
#include "reconstruction/inspection/internal/median.h"

namespace segsim::reconstruction {
namespace {

constexpr int kWidth_px = 320;
constexpr double kSmallestJump = 0.08;  ///< Of depth, relative: an edge and not a slope.
constexpr double kFallOff_px = 1.5;
constexpr int kLargestShift_px = 8;
constexpr std::array kScales{0.96, 0.98, 1.0, 1.02, 1.04};

core::Image<std::uint8_t> nearness(const cv::Mat& edges) {
  core::Image<std::uint8_t> result(edges.cols, edges.rows);
  if (cv::countNonZero(edges) == 0) return result;
  cv::Mat distance_px;
  cv::distanceTransform(edges == 0, distance_px, cv::DIST_L2, cv::DIST_MASK_5);
  for (int y = 0; y < edges.rows; ++y) {
    for (int x = 0; x < edges.cols; ++x) {
      const double d = distance_px.at<float>(y, x) / kFallOff_px;
      result(x, y) = static_cast<std::uint8_t>(std::lround(255.0 * std::exp(-0.5 * d * d)));
    }
  }
  return result;
}

bool jumps(float a_m, float b_m) {
  return a_m > 0.0F && b_m > 0.0F && std::abs(a_m - b_m) > kSmallestJump * std::min(a_m, b_m);
}

/// Between four pixels; -1 outside. Depth edges lie between pixels, colour edges on them.
double nearness_at(const core::Image<std::uint8_t>& near, const glm::dvec2& p) {
  const double u = p.x - 0.5, v = p.y - 0.5;
  const int x = static_cast<int>(std::floor(u)), y = static_cast<int>(std::floor(v));
  if (!near.contains(x, y) || !near.contains(x + 1, y + 1)) return -1.0;
  const double s = u - x, t = v - y;
  return (1.0 - t) * ((1.0 - s) * near(x, y) + s * near(x + 1, y)) +
         t * ((1.0 - s) * near(x, y + 1) + s * near(x + 1, y + 1));
}

EdgeShift agreement_at(std::span<const EdgeView* const> views, const glm::dvec2& shift_px,
                       double scale) {
  double sum = 0.0, points = 0.0;
  for (const EdgeView* view : views) {
    const core::Image<std::uint8_t>& near = view->color_edge_nearness;
    const glm::dvec2 center_px(0.5 * near.width_px(), 0.5 * near.height_px());
    for (const glm::vec2& edge_px : view->depth_edges_px) {
      const glm::dvec2 p = center_px + scale * (glm::dvec2(edge_px) - center_px) + shift_px;
      const double nearness = nearness_at(near, p);
      if (nearness < 0.0) continue;
      sum += nearness;
      points += 1.0;
    }
  }
  return {shift_px, scale, points > 0.0 ? sum / points / 255.0 : 0.0};
}

}  // namespace

EdgeView make_edge_view(const core::Image<core::Rgb8>& rgb,
                        const core::Image<float>& depth_m) {
  cv::Mat grey = internal::grey_image(rgb);
  const double reduction = std::min(1.0, static_cast<double>(kWidth_px) / grey.cols);
  cv::resize(grey, grey, {}, reduction, reduction, cv::INTER_AREA);
  EdgeView view;
  view.color_edge_nearness = nearness(internal::find_color_edges(grey).edges);
  const float sx = static_cast<float>(grey.cols) / static_cast<float>(depth_m.width_px());
  const float sy = static_cast<float>(grey.rows) / static_cast<float>(depth_m.height_px());
  for (int y = 0; y + 1 < depth_m.height_px(); ++y) {
    for (int x = 0; x + 1 < depth_m.width_px(); ++x) {
      const auto fx = static_cast<float>(x), fy = static_cast<float>(y);
      if (jumps(depth_m(x, y), depth_m(x + 1, y))) {
        view.depth_edges_px.emplace_back((fx + 1.0F) * sx, (fy + 0.5F) * sy);
      } else if (jumps(depth_m(x, y), depth_m(x, y + 1))) {
        view.depth_edges_px.emplace_back((fx + 0.5F) * sx, (fy + 1.0F) * sy);
      }
    }
  }
  return view;
}

double EdgeShift::displacement_px(int width_px) const {
  return glm::length(shift_px) + std::abs(scale - 1.0) * 0.25 * width_px;
}

EdgeFit fit_edges(std::span<const EdgeView* const> views) {
  EdgeFit fit;
  std::vector<double> all;
  for (const double scale : kScales) {
    for (int y = -kLargestShift_px; y <= kLargestShift_px; ++y) {
      for (int x = -kLargestShift_px; x <= kLargestShift_px; ++x) {
        const EdgeShift shift = agreement_at(views, {x, y}, scale);
        all.push_back(shift.agreement);
        if (x == 0 && y == 0 && scale == 1.0) fit.given = shift;
        if (shift.agreement > fit.best.agreement) fit.best = shift;
      }
    }
  }
  fit.elsewhere = internal::median(std::move(all));
  return fit;
}

}  // namespace segsim::reconstruction
