#include "reconstruction/datasets/internal/reproject_depth.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <glm/mat3x3.hpp>

#include "core/check.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr float kLargestStep = 0.08F;  ///< Of the nearer depth: more is another surface.
constexpr double kNearest_m = 0.01;    ///< In front of the other camera.

/// A corner in the other image: position and 1 / depth, which is linear across a plane.
struct Corner {
  double x_px = 0.0, y_px = 0.0, inverse_m = 0.0;
};

bool is_one_surface(float a_m, float b_m) {
  return std::abs(a_m - b_m) <= kLargestStep * std::min(a_m, b_m);
}

/// 1 / depth at a corner of pixel (x, y): the mean of the pixels around the corner that belong
/// to the same surface.
/// @param dx, dy  -1 or 1: which corner.
double corner_inverse(const core::Image<float>& depth_m, int x, int y, int dx, int dy) {
  const float own_m = depth_m(x, y);
  double sum = 1.0 / own_m;
  int count = 1;
  for (const auto& [nx, ny] : {std::pair{x + dx, y}, {x, y + dy}, {x + dx, y + dy}}) {
    if (!depth_m.contains(nx, ny)) continue;
    const float other_m = depth_m(nx, ny);
    if (!(other_m > 0.0F) || !is_one_surface(own_m, other_m)) continue;
    sum += 1.0 / other_m;
    ++count;
  }
  return sum / count;
}

/// Keeps the largest 1 / depth of each pixel.
void draw_triangle(const Corner& a, const Corner& b, const Corner& c,
                   core::Image<float>& inverse) {
  const double area =
      (b.x_px - a.x_px) * (c.y_px - a.y_px) - (b.y_px - a.y_px) * (c.x_px - a.x_px);
  if (std::abs(area) < 1e-12) return;
  const auto [left, right] = std::minmax({a.x_px, b.x_px, c.x_px});
  const auto [top, bottom] = std::minmax({a.y_px, b.y_px, c.y_px});
  if (right < 0.5 || bottom < 0.5 || left > inverse.width_px() || top > inverse.height_px()) {
    return;
  }
  // Pixels whose centre lies inside; borders count, so that neighbours leave no gap.
  const int x0 = static_cast<int>(std::max(0.0, std::ceil(left - 0.5)));
  const int y0 = static_cast<int>(std::max(0.0, std::ceil(top - 0.5)));
  const int x1 = static_cast<int>(std::min(inverse.width_px() - 1.0, std::floor(right - 0.5)));
  const int y1 =
      static_cast<int>(std::min(inverse.height_px() - 1.0, std::floor(bottom - 0.5)));
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const double px = x + 0.5 - a.x_px, py = y + 0.5 - a.y_px;
      const double s = (px * (c.y_px - a.y_px) - py * (c.x_px - a.x_px)) / area;
      const double t = ((b.x_px - a.x_px) * py - (b.y_px - a.y_px) * px) / area;
      if (s < -1e-9 || t < -1e-9 || s + t > 1.0 + 1e-9) continue;
      const auto value = static_cast<float>(a.inverse_m + s * (b.inverse_m - a.inverse_m) +
                                            t * (c.inverse_m - a.inverse_m));
      inverse(x, y) = std::max(inverse(x, y), value);
    }
  }
}

}  // namespace

core::Image<float> reproject_depth(const core::Image<float>& depth_m,
                                   const core::CameraIntrinsics& from,
                                   const CameraToCamera& T_to_from,
                                   const core::CameraIntrinsics& to) {
  SEGSIM_CHECK(depth_m.width_px() == from.width_px && depth_m.height_px() == from.height_px,
               "size of the depth image");
  const glm::dmat3 R(glm::mat3_cast(T_to_from.rotation()));
  const glm::dvec3 t_m = T_to_from.translation_m();
  core::Image<float> inverse(to.width_px, to.height_px, 0.0F);
  for (int y = 0; y < depth_m.height_px(); ++y) {
    for (int x = 0; x < depth_m.width_px(); ++x) {
      if (!(depth_m(x, y) > 0.0F)) continue;
      std::array<Corner, 4> corners;  // Clockwise.
      bool in_front = true;
      for (int k = 0; k < 4 && in_front; ++k) {
        const int dx = k == 0 || k == 3 ? -1 : 1, dy = k < 2 ? -1 : 1;
        const double z_m = 1.0 / corner_inverse(depth_m, x, y, dx, dy);
        const glm::dvec3 p_m =
            R * from.back_project({x + 0.5 + 0.5 * dx, y + 0.5 + 0.5 * dy}, z_m) + t_m;
        in_front = p_m.z > kNearest_m;
        if (!in_front) break;
        const glm::dvec2 px = to.project(p_m);
        corners[static_cast<std::size_t>(k)] = {px.x, px.y, 1.0 / p_m.z};
      }
      if (!in_front) continue;
      draw_triangle(corners[0], corners[1], corners[2], inverse);
      draw_triangle(corners[0], corners[2], corners[3], inverse);
    }
  }
  for (float& value : inverse.pixels()) value = value > 0.0F ? 1.0F / value : std::nanf("");
  return inverse;
}

}  // namespace segsim::reconstruction::internal
