#include "sim/sensors/render_validity.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

namespace segsim::sim {
namespace {

glm::dvec3 optical_axis(const core::CameraPose& T_world_camera) {
  return T_world_camera.rotation() * glm::dvec3(0.0, 0.0, 1.0);
}

}  // namespace

RenderValidity render_validity(const core::Image<float>& alpha,
                               const core::CameraPose& T_world_camera,
                               std::span<const core::CameraPose> views, double hole_limit) {
  RenderValidity validity;
  std::size_t holes = 0;
  for (const float a : alpha.pixels()) {
    validity.mean_alpha += a;
    holes += a >= 0.5F ? 0U : 1U;
  }
  const double pixels = std::max(1.0, static_cast<double>(alpha.size()));
  validity.mean_alpha /= pixels;
  validity.hole_share = static_cast<double>(holes) / pixels;
  validity.render_invalid = validity.hole_share > hole_limit;

  constexpr double kUnknown = std::numeric_limits<double>::infinity();
  validity.view_m = validity.view_rad = kUnknown;
  double least = kUnknown;
  const glm::dvec3 axis = optical_axis(T_world_camera);
  for (const core::CameraPose& view : views) {
    const double away_m = glm::distance(view.translation_m(), T_world_camera.translation_m());
    if (away_m >= least) continue;
    const double turned_rad =
        std::acos(std::clamp(glm::dot(axis, optical_axis(view)), -1.0, 1.0));
    if (away_m + turned_rad >= least) continue;
    least = away_m + turned_rad;
    validity.view_m = away_m;
    validity.view_rad = turned_rad;
  }
  return validity;
}

RenderValiditySummary summary_of(std::span<const RenderValidity> images) {
  RenderValiditySummary sum;
  for (const RenderValidity& image : images) {
    ++sum.images;
    sum.invalid_images += image.render_invalid ? 1 : 0;
    sum.mean_alpha += image.mean_alpha;
    sum.hole_share += image.hole_share;
    sum.view_m += image.view_m;
    sum.view_rad += image.view_rad;
    sum.farthest_view_m = std::max(sum.farthest_view_m, image.view_m);
  }
  const double n = std::max(1, sum.images);
  sum.mean_alpha /= n;
  sum.hole_share /= n;
  sum.view_m /= n;
  sum.view_rad /= n;
  return sum;
}

}  // namespace segsim::sim
