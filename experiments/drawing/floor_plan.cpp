#include "experiments/drawing/floor_plan.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <glm/common.hpp>
#include <glm/vec3.hpp>

#include "core/quantile.h"

namespace segsim::experiments::drawing {
namespace {

constexpr float kMinOpacity = 0.3F;
constexpr double kMargin_m = 0.4;
constexpr int kLargestSide_px = 2400;

double quantile(const std::vector<float>& values, double share) {
  return core::quantile(values, share, core::Between::kLower);
}

core::Rgb8 to_rgb8(const glm::vec3& srgb) {
  const glm::vec3 scaled = glm::clamp(srgb, 0.0F, 1.0F) * 255.0F + 0.5F;
  return {static_cast<std::uint8_t>(scaled.x), static_cast<std::uint8_t>(scaled.y),
          static_cast<std::uint8_t>(scaled.z)};
}

/// Colour of a surfel in the plan: its own (degree 0), upright surfaces a little darker so
/// that walls and the sides of furniture stand out, and all of it a little brighter for the
/// overlays.
core::Rgb8 plan_color(const renderer::SurfelCloud& surfels, std::size_t i) {
  const glm::vec3 own = 0.5F + renderer::kShC0 * surfels.sh[i * surfels.sh_count()];
  const glm::vec3 normal = surfels.R_world_surfel[i] * glm::vec3(0.0F, 0.0F, 1.0F);
  const float level = 0.62F + 0.38F * std::abs(normal.z);
  return to_rgb8(glm::mix(own * level, glm::vec3(1.0F), 0.18F));
}

void paint_square(core::Image<core::Rgb8>& image, const glm::dvec2& center_px, double half_px,
                  const core::Rgb8& color) {
  const int x0 = std::max(0, static_cast<int>(std::floor(center_px.x - half_px)));
  const int y0 = std::max(0, static_cast<int>(std::floor(center_px.y - half_px)));
  const int x1 =
      std::min(image.width_px() - 1, static_cast<int>(std::floor(center_px.x + half_px)));
  const int y1 =
      std::min(image.height_px() - 1, static_cast<int>(std::floor(center_px.y + half_px)));
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) image(x, y) = color;
  }
}

}  // namespace

FloorPlan make_floor_plan(const renderer::SurfelCloud& surfels, double max_height_m,
                          double px_per_m) {
  constexpr core::Rgb8 kPaper{250, 250, 248};
  std::vector<std::size_t> visible;
  for (std::size_t i = 0; i < surfels.size(); ++i) {
    const float z = surfels.position_m[i].z;
    if (z < max_height_m && z > -0.5F && surfels.opacity[i] >= kMinOpacity)
      visible.push_back(i);
  }
  FloorPlan plan;
  plan.px_per_m = px_per_m;
  if (visible.empty()) {
    plan.rgb = core::Image<core::Rgb8>(16, 16, kPaper);
    return plan;
  }
  std::vector<float> xs, ys;
  for (const std::size_t i : visible) {
    xs.push_back(surfels.position_m[i].x);
    ys.push_back(surfels.position_m[i].y);
  }
  constexpr double kStray = 0.001;
  const glm::dvec2 low{quantile(xs, kStray) - kMargin_m, quantile(ys, kStray) - kMargin_m};
  const glm::dvec2 high{quantile(xs, 1.0 - kStray) + kMargin_m,
                        quantile(ys, 1.0 - kStray) + kMargin_m};
  const double largest_m = std::max(high.x - low.x, high.y - low.y);
  plan.px_per_m = std::min(px_per_m, kLargestSide_px / largest_m);
  plan.origin_m = low;
  plan.rgb = core::Image<core::Rgb8>(
      std::max(1, static_cast<int>(std::ceil((high.x - low.x) * plan.px_per_m))),
      std::max(1, static_cast<int>(std::ceil((high.y - low.y) * plan.px_per_m))), kPaper);

  // Painter's order: from the floor upwards, equal heights by index.
  std::stable_sort(visible.begin(), visible.end(), [&](std::size_t a, std::size_t b) {
    return surfels.position_m[a].z < surfels.position_m[b].z;
  });
  for (const std::size_t i : visible) {
    const glm::vec3& p = surfels.position_m[i];
    const double radius_m =
        std::min(0.05F, 1.2F * std::max(surfels.scale_m[i].x, surfels.scale_m[i].y));
    paint_square(plan.rgb, plan.to_px({p.x, p.y}), std::max(0.5, radius_m * plan.px_per_m),
                 plan_color(surfels, i));
  }
  return plan;
}

}  // namespace segsim::experiments::drawing
