#include "reconstruction/inspection/internal/edge_maps.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <glm/geometric.hpp>
#include <opencv2/imgproc.hpp>

namespace segsim::reconstruction::internal {
namespace {

constexpr float kSmallestJump = 0.08F;  ///< Of depth, relative: an edge and not a slope.
constexpr int kWidestGap_px = 6;        ///< Without depth, in the shadow of an edge.
constexpr float kUnits = 16.0F;         ///< Of a stored distance, a pixel.
/// Edges count for every direction that they differ from by less: no edge falls between two.
constexpr double kSpread_rad = 35.0 * std::numbers::pi / 180.0;
constexpr double kSector_rad = std::numbers::pi / DirectedEdges::kDirections;

/// Of lines: between 0 and 90 degrees.
double angle_between_rad(double a_rad, double b_rad) {
  return std::abs(std::remainder(a_rad - b_rad, std::numbers::pi));
}

/// Inverse depth without holes, by the last measurement of the row: good enough to tell how an
/// edge runs.
cv::Mat filled_inverse(const core::Image<float>& depth_m) {
  cv::Mat inverse(depth_m.height_px(), depth_m.width_px(), CV_32F);
  for (int y = 0; y < depth_m.height_px(); ++y) {
    float last = 0.0F;
    auto* row = inverse.ptr<float>(y);
    for (int x = 0; x < depth_m.width_px(); ++x) {
      if (depth_m(x, y) > 0.0F) last = 1.0F / depth_m(x, y);
      row[x] = last;
    }
  }
  cv::GaussianBlur(inverse, inverse, {}, 1.0);
  return inverse;
}

cv::Mat magnitude(const ColorEdges& color) {
  cv::Mat result;
  cv::magnitude(color.dx, color.dy, result);
  return result;
}

/// Where the gradient is largest across the edge at pixel (x, y). Without this, an edge
/// between two pixels would always be on the left one.
glm::vec2 between_pixels(const ColorEdges& color, const cv::Mat& strength, int x, int y) {
  const glm::vec2 center_px(static_cast<float>(x) + 0.5F, static_cast<float>(y) + 0.5F);
  if (x < 1 || y < 1 || x + 1 >= strength.cols || y + 1 >= strength.rows) return center_px;
  const float dx = color.dx.at<float>(y, x), dy = color.dy.at<float>(y, x);
  // Along the axis that the gradient is nearer to; the other one follows.
  const bool along_x = std::abs(dx) >= std::abs(dy);
  const float slope = along_x ? dy / dx : dx / dy;
  const auto at = [&](int side) {
    const float across = slope * static_cast<float>(side);
    const int step = across < 0.0F ? -1 : 1;
    const float share = std::abs(across);
    const auto value = [&](int along, int other) {
      return along_x ? strength.at<float>(y + other, x + along)
                     : strength.at<float>(y + along, x + other);
    };
    return (1.0F - share) * value(side, 0) + share * value(side, step);
  };
  const float before = at(-1), here = strength.at<float>(y, x), after = at(1);
  const float curvature = before - 2.0F * here + after;
  if (!(curvature < 0.0F)) return center_px;
  const float offset = std::clamp(0.5F * (before - after) / curvature, -0.7F, 0.7F);
  return center_px + offset * (along_x ? glm::vec2(1.0F, slope) : glm::vec2(slope, 1.0F));
}

}  // namespace

ColorEdges find_color_edges(const cv::Mat& grey) {
  ColorEdges result;
  cv::Mat smooth;
  cv::GaussianBlur(grey, smooth, {}, 1.0);
  cv::Sobel(smooth, result.dx, CV_32F, 1, 0);
  cv::Sobel(smooth, result.dy, CV_32F, 0, 1);
  const cv::Mat strength = cv::abs(result.dx) + cv::abs(result.dy);
  std::vector<float> sorted(strength.begin<float>(), strength.end<float>());
  const auto tenth = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() * 9 / 10);
  std::nth_element(sorted.begin(), tenth, sorted.end());
  const double high = std::max(30.0, static_cast<double>(*tenth));
  cv::Canny(smooth, result.edges, 0.5 * high, high);
  return result;
}

int DirectedEdges::direction_of(double dx, double dy) {
  const double sector = std::atan2(dy, dx) / kSector_rad;
  return (static_cast<int>(std::lround(sector)) + 2 * kDirections) % kDirections;
}

DirectedEdges::DirectedEdges(const cv::Mat& grey) {
  const ColorEdges color = find_color_edges(grey);
  const cv::Mat strength = magnitude(color);
  for (int k = 0; k < kDirections; ++k) {
    cv::Mat free(grey.rows, grey.cols, CV_8U, cv::Scalar(1));
    std::vector<glm::vec2> edges_px{glm::vec2(0.0F)};  // By label, which counts from 1.
    for (int y = 0; y < grey.rows; ++y) {
      for (int x = 0; x < grey.cols; ++x) {
        if (color.edges.at<std::uint8_t>(y, x) == 0) continue;
        const double angle_rad =
            std::atan2(color.dy.at<float>(y, x), color.dx.at<float>(y, x));
        if (angle_between_rad(angle_rad, k * kSector_rad) < kSpread_rad) {
          free.at<std::uint8_t>(y, x) = 0;
        }
      }
    }
    core::Image<std::uint8_t>& stored = distance_[static_cast<std::size_t>(k)];
    const auto farthest = static_cast<std::uint8_t>(kUnits * kFarthest_px);
    stored = core::Image<std::uint8_t>(grey.cols, grey.rows, farthest);
    if (cv::countNonZero(free) == grey.rows * grey.cols) continue;
    cv::Mat distance_px, label;
    cv::distanceTransform(free, distance_px, label, cv::DIST_L2, cv::DIST_MASK_5,
                          cv::DIST_LABEL_PIXEL);
    // Labels are given to edge pixels row by row, but that is nowhere promised.
    for (int y = 0; y < grey.rows; ++y) {
      for (int x = 0; x < grey.cols; ++x) {
        if (free.at<std::uint8_t>(y, x) != 0) continue;
        const auto at = static_cast<std::size_t>(label.at<std::int32_t>(y, x));
        if (at >= edges_px.size()) edges_px.resize(at + 1);
        edges_px[at] = between_pixels(color, strength, x, y);
      }
    }
    for (int y = 0; y < grey.rows; ++y) {
      for (int x = 0; x < grey.cols; ++x) {
        const glm::vec2 edge_px =
            edges_px[static_cast<std::size_t>(label.at<std::int32_t>(y, x))];
        const float units =
            kUnits * glm::distance(edge_px, glm::vec2(static_cast<float>(x) + 0.5F,
                                                      static_cast<float>(y) + 0.5F));
        stored(x, y) = static_cast<std::uint8_t>(
            std::lround(std::min(units, static_cast<float>(farthest))));
      }
    }
  }
}

DirectedEdges::Sample DirectedEdges::at(int direction, const glm::dvec2& px) const {
  const core::Image<std::uint8_t>& d = distance_[static_cast<std::size_t>(direction)];
  const double u = px.x - 0.5, v = px.y - 0.5;
  if (!(u >= 0.0 && v >= 0.0 && u < d.width_px() - 1 && v < d.height_px() - 1)) return {};
  const int x = static_cast<int>(u), y = static_cast<int>(v);
  const auto s = static_cast<float>(u - x), t = static_cast<float>(v - y);
  const float a = d(x, y), b = d(x + 1, y), c = d(x, y + 1), e = d(x + 1, y + 1);
  return {
      ((1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * e)) / kUnits,
      glm::vec2((1 - t) * (b - a) + t * (e - c), (1 - s) * (c - a) + s * (e - b)) / kUnits};
}

std::vector<ContourPoint> find_contours(const core::Image<float>& depth_m,
                                        const core::CameraIntrinsics& camera) {
  cv::Mat dx, dy;
  const cv::Mat inverse = filled_inverse(depth_m);
  cv::Sobel(inverse, dx, CV_32F, 1, 0);
  cv::Sobel(inverse, dy, CV_32F, 0, 1);
  std::vector<ContourPoint> points;
  /// Two measurements in one row or column, and where they are.
  const auto add = [&](int ax, int ay, int bx, int by) {
    const float a_m = depth_m(ax, ay), b_m = depth_m(bx, by);
    if (!(std::abs(a_m - b_m) > kSmallestJump * std::min(a_m, b_m))) return;
    const bool a_is_near = a_m < b_m;
    const int x = a_is_near ? ax : bx, y = a_is_near ? ay : by;
    const double side = a_is_near ? 0.5 : -0.5;
    const glm::dvec2 px(x + 0.5 + (ay == by ? side : 0.0), y + 0.5 + (ay == by ? 0.0 : side));
    points.push_back({glm::vec3(camera.back_project(px, std::min(a_m, b_m))),
                      DirectedEdges::direction_of(dx.at<float>(y, x), dy.at<float>(y, x))});
  };
  for (int y = 0; y < depth_m.height_px(); ++y) {
    int last = -1;
    for (int x = 0; x < depth_m.width_px(); ++x) {
      if (!(depth_m(x, y) > 0.0F)) continue;
      if (last >= 0 && x - last - 1 <= kWidestGap_px) add(last, y, x, y);
      last = x;
    }
  }
  for (int x = 0; x < depth_m.width_px(); ++x) {
    int last = -1;
    for (int y = 0; y < depth_m.height_px(); ++y) {
      if (!(depth_m(x, y) > 0.0F)) continue;
      if (last >= 0 && y - last - 1 <= kWidestGap_px) add(x, last, x, y);
      last = y;
    }
  }
  return points;
}

}  // namespace segsim::reconstruction::internal
