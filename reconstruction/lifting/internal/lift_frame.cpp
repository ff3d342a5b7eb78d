#include "reconstruction/lifting/internal/lift_frame.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>

namespace segsim::reconstruction::internal {
namespace {

constexpr int kRadius_px = 2;
constexpr int kFewestNeighbors = 7;
/// Neighbours at distance r_px belong to the same surface if their depth differs by less than
/// (kStep_m + kStepRatio z) r_px. The floor 5 m away, seen from 1.6 m, changes by 3 cm per
/// pixel.
constexpr float kStep_m = 0.006F, kStepRatio = 0.010F;
constexpr float kNearestWeighted_m = 0.5F;

/// Accumulates the normal equations of n . (x, y, 1) = 1/z: a plane is linear in inverse
/// depth, so the fit is exact for it at any slant.
struct PlaneFit {
  float xx = 0, xy = 0, yy = 0, x1 = 0, y1 = 0, n = 0, bx = 0, by = 0, b1 = 0;

  void add(float x, float y, float inverse_z) {
    xx += x * x, xy += x * y, yy += y * y, x1 += x, y1 += y, n += 1.0F;
    bx += x * inverse_z, by += y * inverse_z, b1 += inverse_z;
  }
  /// (gradient x, gradient y, value at 0) of 1/z; false if the points lie on a line.
  [[nodiscard]] bool solve(glm::vec3& plane) const {
    const float mx = x1 / n, my = y1 / n, mb = b1 / n;
    const float cxx = xx - mx * x1, cxy = xy - mx * y1, cyy = yy - my * y1;
    const float cxb = bx - mx * b1, cyb = by - my * b1;
    const float determinant = cxx * cyy - cxy * cxy;
    if (!(determinant > 0.02F * cxx * cyy) || !(cxx * cyy > 0.0F)) return false;
    plane.x = (cyy * cxb - cxy * cyb) / determinant;
    plane.y = (cxx * cyb - cxy * cxb) / determinant;
    plane.z = mb - plane.x * mx - plane.y * my;
    return true;
  }
};

/// Depth image with what all pixels share.
struct DepthView {
  const core::Image<float>& depth_m;
  core::CameraIntrinsics camera;
  core::Image<float> inverse_depth;  ///< [1/m]
  std::array<float, 2 * kRadius_px + 1> ray_x{},
      ray_y{};  ///< Of neighbours, from the pixel's ray.

  DepthView(const core::Image<float>& depth, const core::CameraIntrinsics& intrinsics);

  /// Unit normal in the camera frame, towards the camera; false at depth edges.
  [[nodiscard]] bool normal_at(int x, int y, float z, glm::vec3& normal) const;
};

DepthView::DepthView(const core::Image<float>& depth, const core::CameraIntrinsics& intrinsics)
    : depth_m(depth), camera(intrinsics), inverse_depth(depth.width_px(), depth.height_px()) {
  std::transform(depth.data(), depth.data() + depth.size(), inverse_depth.data(),
                 [](float z) { return 1.0F / z; });
  for (int d = -kRadius_px; d <= kRadius_px; ++d) {
    const auto i = static_cast<std::size_t>(d + kRadius_px);
    ray_x[i] = static_cast<float>(d) / static_cast<float>(camera.fx_px);
    ray_y[i] = static_cast<float>(d) / static_cast<float>(camera.fy_px);
  }
}

bool DepthView::normal_at(int x, int y, float z, glm::vec3& normal) const {
  PlaneFit fit;
  int valid = 0, similar = 0;
  const float step_m = kStep_m + kStepRatio * z;
  const int x_end = std::min(x + kRadius_px, depth_m.width_px() - 1);
  const int y_end = std::min(y + kRadius_px, depth_m.height_px() - 1);
  for (int ny = std::max(0, y - kRadius_px); ny <= y_end; ++ny) {
    const float* row = depth_m.row(ny);
    const float* inverse_row = inverse_depth.row(ny);
    for (int nx = std::max(0, x - kRadius_px); nx <= x_end; ++nx) {
      const float nz = row[nx];
      if (!(nz > 0.0F)) continue;
      ++valid;
      const int reach = std::max({1, std::abs(nx - x), std::abs(ny - y)});
      if (std::abs(nz - z) > step_m * static_cast<float>(reach)) continue;
      ++similar;
      // Coordinates relative to the pixel keep the sums well conditioned.
      fit.add(ray_x[static_cast<std::size_t>(nx - x + kRadius_px)],
              ray_y[static_cast<std::size_t>(ny - y + kRadius_px)], inverse_row[nx]);
    }
  }
  if (similar < kFewestNeighbors || 2 * similar < valid) return false;
  glm::vec3 plane;
  if (!fit.solve(plane)) return false;
  const auto px = static_cast<float>((x + 0.5 - camera.cx_px) / camera.fx_px);
  const auto py = static_cast<float>((y + 0.5 - camera.cy_px) / camera.fy_px);
  plane.z -= plane.x * px + plane.y * py;  // Value on the optical axis.
  const float length = glm::length(plane);
  if (!(length > 0.0F)) return false;
  normal = -plane / length;  // n . X = 1 > 0 points away from the camera.
  return true;
}

}  // namespace

FrameSamples sample_frame(const RgbdFrame& frame, const core::CameraIntrinsics& intrinsics,
                          const LiftOptions& options, DepthSensor sensor) {
  const core::Image<float>& depth = frame.depth_m;
  const DepthView view(depth, intrinsics.resized(depth.width_px(), depth.height_px()));
  const glm::mat3 R_world_camera(glm::mat3_cast(frame.T_world_camera.rotation()));
  const glm::vec3 camera_m(frame.T_world_camera.translation_m());
  const auto smallest_cos =
      static_cast<float>(std::cos(options.max_grazing_deg * 3.14159265358979 / 180.0));
  const bool labels = !frame.semantic.empty();

  FrameSamples result;
  result.samples.reserve(depth.size() / 2);
  for (int y = 0; y < depth.height_px(); ++y) {
    const int color_y = y * frame.rgb.height_px() / depth.height_px();
    for (int x = 0; x < depth.width_px(); ++x) {
      const float z = depth(x, y);
      if (!(z >= static_cast<float>(options.min_depth_m) &&
            z <= static_cast<float>(options.max_depth_m))) {
        continue;
      }
      ++result.pixels_valid;
      const glm::vec3 point(view.camera.back_project({x + 0.5, y + 0.5}, z));
      glm::vec3 normal;
      if (!view.normal_at(x, y, z, normal)) {
        ++result.pixels_dropped;
        continue;
      }
      const float cos_incidence = -glm::dot(normal, point) / glm::length(point);
      if (cos_incidence < smallest_cos) {
        ++result.pixels_dropped;
        continue;
      }
      const int color_x = x * frame.rgb.width_px() / depth.width_px();
      const core::Rgb8 rgb = frame.rgb(color_x, color_y);
      const float clamped_z = std::max(z, kNearestWeighted_m);
      LiftSample sample;
      sample.position_m = R_world_camera * point + camera_m;
      sample.normal = R_world_camera * normal;
      sample.color = glm::vec3(rgb.r, rgb.g, rgb.b) / 255.0F;
      sample.weight = cos_incidence / (clamped_z * clamped_z);
      if (sensor != DepthSensor::kUnstated) {
        const float weight = depth_weight(sensor, clamped_z);
        sample.weight = cos_incidence * weight * weight;
      }
      sample.color_weight = sample.weight * cos_incidence;
      sample.label = labels ? label_pair(frame.semantic(color_x, color_y),
                                         frame.instance(color_x, color_y))
                            : 0;
      result.samples.push_back(sample);
    }
  }
  return result;
}

}  // namespace segsim::reconstruction::internal
