#include "reconstruction/inspection/depth_thumbnail.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "reconstruction/inspection/internal/median.h"

namespace segsim::reconstruction {
namespace {

constexpr int kWidth_px = 96;
constexpr double kLargestStep = 1.1;  ///< Nearest to farthest of four neighbours.
constexpr double kTolerance = 0.03;

}  // namespace

DepthThumbnail make_depth_thumbnail(const core::Image<float>& depth_m,
                                    const core::CameraIntrinsics& intrinsics) {
  DepthThumbnail thumbnail;
  if (depth_m.empty()) return thumbnail;
  const int width_px = std::min(kWidth_px, depth_m.width_px());
  const int height_px =
      std::max(1, static_cast<int>(std::lround(static_cast<double>(depth_m.height_px()) *
                                               width_px / depth_m.width_px())));
  thumbnail.camera = intrinsics.resized(width_px, height_px);
  thumbnail.depth_m = core::Image<float>(width_px, height_px);
  for (int y = 0; y < height_px; ++y) {
    const int from_y = (2 * y + 1) * depth_m.height_px() / (2 * height_px);
    for (int x = 0; x < width_px; ++x) {
      const int from_x = (2 * x + 1) * depth_m.width_px() / (2 * width_px);
      thumbnail.depth_m(x, y) = depth_m(from_x, from_y);
    }
  }
  return thumbnail;
}

double depth_between_m(const DepthThumbnail& thumbnail, const glm::dvec2& px) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const core::Image<float>& depth_m = thumbnail.depth_m;
  const double u = px.x - 0.5, v = px.y - 0.5;
  if (!(u >= 0.0 && v >= 0.0 && u < depth_m.width_px() - 1 && v < depth_m.height_px() - 1)) {
    return kNone;
  }
  const int x = static_cast<int>(u), y = static_cast<int>(v);
  const std::array<double, 4> four{depth_m(x, y), depth_m(x + 1, y), depth_m(x, y + 1),
                                   depth_m(x + 1, y + 1)};
  double nearest = std::numeric_limits<double>::infinity(), farthest = 0.0;
  for (const double d : four) {
    if (!(d > 0.0)) return kNone;
    nearest = std::min(nearest, d), farthest = std::max(farthest, d);
  }
  if (farthest > kLargestStep * nearest) return kNone;
  // On a plane it is the inverse of depth that is linear in the image.
  const double s = u - x, t = v - y;
  return 1.0 / ((1.0 - t) * ((1.0 - s) / four[0] + s / four[1]) +
                t * ((1.0 - s) / four[2] + s / four[3]));
}

DepthAgreement compare_depth(
    const DepthThumbnail& a, const DepthThumbnail& b,
    const core::Transform<core::frame::Camera, core::frame::Camera>& T_b_a, double scale,
    int step) {
  DepthAgreement result;
  std::vector<double> errors_m;
  const glm::dmat3 R_b_a = glm::mat3_cast(T_b_a.rotation());
  const glm::dvec3 p_b_a = scale * T_b_a.translation_m();
  for (int y = step / 2; y < a.depth_m.height_px(); y += step) {
    for (int x = step / 2; x < a.depth_m.width_px(); x += step) {
      const double depth_m = a.depth_m(x, y);
      if (!(depth_m > 0.0)) continue;
      ++result.points;
      const glm::dvec3 p_b =
          R_b_a * a.camera.back_project({x + 0.5, y + 0.5}, depth_m) + p_b_a;
      if (!(p_b.z > 1e-6)) continue;
      const double measured_m = depth_between_m(b, b.camera.project(p_b));
      if (!(measured_m > 0.0)) continue;
      ++result.landed;
      errors_m.push_back(std::abs(p_b.z - measured_m));
      if (errors_m.back() <= kTolerance * measured_m) ++result.matched;
    }
  }
  if (!errors_m.empty()) result.median_error_m = internal::median(std::move(errors_m));
  return result;
}

}  // namespace segsim::reconstruction
