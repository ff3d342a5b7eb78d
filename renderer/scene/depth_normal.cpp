#include "renderer/scene/depth_normal.h"

#include <cmath>
#include <limits>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>

#include "core/check.h"

namespace segsim::renderer {
namespace {

/// Depths of the image, readable beyond its ends.
class DepthReader {
 public:
  explicit DepthReader(const core::Image<float>& depth_m) : depth_m_(depth_m) {}

  /// 1 / depth; NaN where it is unknown.
  [[nodiscard]] float inverse(int x, int y) const {
    if (!depth_m_.contains(x, y)) return kUnknown;
    const float depth_m = depth_m_(x, y);
    return depth_m > 0.0F && std::isfinite(depth_m) ? 1.0F / depth_m : kUnknown;
  }

 private:
  static constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
  const core::Image<float>& depth_m_;
};

/// 1 / depth of five pixels along an axis; the pixel itself is the middle one.
struct Line {
  float before2, before, here, after, after2;
};

/// Which neighbours lie on the pixel's surface.
struct Sides {
  bool before, after;
  [[nodiscard]] bool any() const { return before || after; }
};

float bend(float a, float b, float c) { return std::abs(0.5F * (a + c) - b) / b; }

/// How badly one side continues the pixel's surface; infinite if it does not.
float misfit(float here, float near, float far, const DepthNormalOptions& options) {
  constexpr float kNone = std::numeric_limits<float>::infinity();
  if (std::isnan(near)) return kNone;
  if (std::isnan(far)) {
    return std::abs(near - here) / here <= options.max_step ? options.max_bend : kNone;
  }
  const float off = bend(here, near, far);
  return off <= options.max_bend ? off : kNone;
}

Sides surface_sides(const Line& line, const DepthNormalOptions& options) {
  // False if a neighbour is unknown.
  if (bend(line.before, line.here, line.after) <= options.max_bend) return {true, true};
  const float before = misfit(line.here, line.before, line.before2, options);
  const float after = misfit(line.here, line.after, line.after2, options);
  if (std::isinf(before) && std::isinf(after)) return {false, false};
  return {before <= after, after < before};
}

}  // namespace

void depth_normal_rows(const core::Image<float>& depth_m,
                       const core::CameraIntrinsics& intrinsics,
                       const core::CameraPose& T_world_camera, int y_begin, int y_end,
                       core::Image<glm::vec3>& normals, const DepthNormalOptions& options) {
  SEGSIM_CHECK(
      depth_m.width_px() == normals.width_px() && depth_m.height_px() == normals.height_px(),
      "size of the normals");
  SEGSIM_CHECK(y_begin >= 0 && y_begin <= y_end && y_end <= depth_m.height_px(), "rows");
  const DepthReader depths(depth_m);
  const glm::mat3 R_world_camera(glm::mat3_cast(T_world_camera.rotation()));
  const auto fx = static_cast<float>(intrinsics.fx_px),
             fy = static_cast<float>(intrinsics.fy_px);
  const auto point = [&](int x, int y, float inverse_depth) {
    const float depth = 1.0F / inverse_depth;
    const float u = static_cast<float>(x) + 0.5F - static_cast<float>(intrinsics.cx_px);
    const float v = static_cast<float>(y) + 0.5F - static_cast<float>(intrinsics.cy_px);
    return glm::vec3(u / fx * depth, v / fy * depth, depth);
  };
  for (int y = y_begin; y < y_end; ++y) {
    for (int x = 0; x < depth_m.width_px(); ++x) {
      glm::vec3& normal = normals(x, y);
      normal = glm::vec3(0.0F);
      const float here = depths.inverse(x, y);
      if (std::isnan(here)) continue;
      const Line row{depths.inverse(x - 2, y), depths.inverse(x - 1, y), here,
                     depths.inverse(x + 1, y), depths.inverse(x + 2, y)};
      const Line column{depths.inverse(x, y - 2), depths.inverse(x, y - 1), here,
                        depths.inverse(x, y + 1), depths.inverse(x, y + 2)};
      const Sides along_x = surface_sides(row, options);
      const Sides along_y = surface_sides(column, options);
      if (!along_x.any() || !along_y.any()) continue;
      const glm::vec3 centre = point(x, y, here);
      const glm::vec3 dx = (along_x.after ? point(x + 1, y, row.after) : centre) -
                           (along_x.before ? point(x - 1, y, row.before) : centre);
      const glm::vec3 dy = (along_y.after ? point(x, y + 1, column.after) : centre) -
                           (along_y.before ? point(x, y - 1, column.before) : centre);
      const glm::vec3 across = glm::cross(dy, dx);
      const float length = glm::length(across);
      if (!(length > 0.0F)) continue;
      const float sign = glm::dot(across, centre) > 0.0F ? -1.0F : 1.0F;
      normal = R_world_camera * (across * (sign / length));
    }
  }
}

core::Image<glm::vec3> depth_normals(const core::Image<float>& depth_m,
                                     const core::CameraIntrinsics& intrinsics,
                                     const core::CameraPose& T_world_camera,
                                     const DepthNormalOptions& options) {
  core::Image<glm::vec3> normals(depth_m.width_px(), depth_m.height_px());
  depth_normal_rows(depth_m, intrinsics, T_world_camera, 0, depth_m.height_px(), normals,
                    options);
  return normals;
}

}  // namespace segsim::renderer
