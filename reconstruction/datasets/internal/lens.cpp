#include "reconstruction/datasets/internal/lens.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

namespace segsim::reconstruction::internal {
namespace {

/// Does the straight camera, with focal lengths `zoom` times the lens's, stay in the picture?
bool stays_inside(const Lens& lens, double zoom) {
  const core::CameraIntrinsics& c = lens.camera;
  constexpr int kSamples = 64;
  for (int i = 0; i <= kSamples; ++i) {
    const double x = (i / static_cast<double>(kSamples) - 0.5) * c.width_px / (zoom * c.fx_px);
    const double y =
        (i / static_cast<double>(kSamples) - 0.5) * c.height_px / (zoom * c.fy_px);
    const double right = 0.5 * c.width_px / (zoom * c.fx_px);
    const double bottom = 0.5 * c.height_px / (zoom * c.fy_px);
    for (const glm::dvec2 ray : {glm::dvec2{x, -bottom}, glm::dvec2{x, bottom},
                                 glm::dvec2{-right, y}, glm::dvec2{right, y}}) {
      const glm::dvec2 px = lens.project(ray);
      if (!(px.x >= 0.0 && px.y >= 0.0 && px.x <= c.width_px && px.y <= c.height_px)) {
        return false;
      }
    }
  }
  return true;
}

}  // namespace

bool Lens::bends() const {
  return model != LensModel::kPinhole &&
         (model == LensModel::kFisheye || p1 != 0.0 || p2 != 0.0 ||
          std::any_of(k.begin(), k.end(), [](double value) { return value != 0.0; }));
}

bool Lens::operator==(const Lens& other) const {
  const core::CameraIntrinsics &a = camera, &b = other.camera;
  return model == other.model && k == other.k && p1 == other.p1 && p2 == other.p2 &&
         a.width_px == b.width_px && a.height_px == b.height_px && a.fx_px == b.fx_px &&
         a.fy_px == b.fy_px && a.cx_px == b.cx_px && a.cy_px == b.cy_px;
}

glm::dvec2 Lens::project(const glm::dvec2& ray) const {
  glm::dvec2 bent = ray;
  const double r2 = glm::dot(ray, ray);
  if (model == LensModel::kBrown) {
    const double radial = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]));
    bent =
        ray * radial + glm::dvec2{2.0 * p1 * ray.x * ray.y + p2 * (r2 + 2.0 * ray.x * ray.x),
                                  p1 * (r2 + 2.0 * ray.y * ray.y) + 2.0 * p2 * ray.x * ray.y};
  } else if (model == LensModel::kFisheye && r2 > 1e-24) {
    const double r = std::sqrt(r2), theta = std::atan(r), t2 = theta * theta;
    const double bent_theta =
        theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
    bent = ray * (bent_theta / r);
  }
  return {camera.fx_px * bent.x + camera.cx_px, camera.fy_px * bent.y + camera.cy_px};
}

core::CameraIntrinsics straight_camera(const Lens& lens) {
  if (!lens.bends()) return lens.camera;
  double narrow = 0.25, wide_enough = 8.0;  // Zoom factors; a larger one sees less.
  for (int i = 0; i < 60; ++i) {
    const double zoom = 0.5 * (narrow + wide_enough);
    (stays_inside(lens, zoom) ? wide_enough : narrow) = zoom;
  }
  core::CameraIntrinsics camera = lens.camera;
  camera.fx_px *= wide_enough, camera.fy_px *= wide_enough;
  camera.cx_px = 0.5 * camera.width_px, camera.cy_px = 0.5 * camera.height_px;
  return camera;
}

Undistortion::Undistortion(const Lens& lens, const core::CameraIntrinsics& straight,
                           int width_px, int height_px)
    : width_px_(width_px), height_px_(height_px) {
  const core::CameraIntrinsics camera = straight.resized(width_px, height_px);
  const glm::dvec2 scale{static_cast<double>(width_px) / lens.camera.width_px,
                         static_cast<double>(height_px) / lens.camera.height_px};
  source_px_.reserve(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px));
  for (int y = 0; y < height_px; ++y) {
    for (int x = 0; x < width_px; ++x) {
      const glm::dvec3 ray = camera.back_project({x + 0.5, y + 0.5}, 1.0);
      source_px_.emplace_back(lens.project({ray.x, ray.y}) * scale);
    }
  }
}

core::Image<core::Rgb8> Undistortion::color(const core::Image<core::Rgb8>& image) const {
  SEGSIM_CHECK(image.width_px() == width_px_ && image.height_px() == height_px_,
               "size of the image");
  core::Image<core::Rgb8> straight(width_px_, height_px_);
  for (std::size_t i = 0; i < source_px_.size(); ++i) {
    const float x = source_px_[i].x - 0.5F, y = source_px_[i].y - 0.5F;
    const float left = std::floor(x), top = std::floor(y);
    const float fx = x - left, fy = y - top;
    const int x0 = clamp(left, width_px_), x1 = clamp(left + 1.0F, width_px_);
    const int y0 = clamp(top, height_px_), y1 = clamp(top + 1.0F, height_px_);
    const auto blend = [&](std::uint8_t core::Rgb8::*channel) {
      const float above = (1.0F - fx) * image(x0, y0).*channel + fx * image(x1, y0).*channel;
      const float below = (1.0F - fx) * image(x0, y1).*channel + fx * image(x1, y1).*channel;
      return static_cast<std::uint8_t>(std::floor((1.0F - fy) * above + fy * below + 0.5F));
    };
    straight.pixels()[i] = {blend(&core::Rgb8::r), blend(&core::Rgb8::g),
                            blend(&core::Rgb8::b)};
  }
  return straight;
}

}  // namespace segsim::reconstruction::internal
