#pragma once

/// @file
/// Depth images of shapes that have formulas.

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/frames.h"
#include "core/random.h"
#include "worlds/surface/depth_fusion.h"

namespace segsim::worlds {

/// Distance along a ray (unit direction) to the first surface; NaN if there is none.
using RayShape =
    std::function<double(const glm::dvec3& origin_m, const glm::dvec3& direction)>;

/// The plane n . p = offset.
inline RayShape plane_shape(const glm::dvec3& n, double offset_m) {
  return [=](const glm::dvec3& o, const glm::dvec3& d) {
    const double t = (offset_m - glm::dot(n, o)) / glm::dot(n, d);
    return t > 0.0 ? t : std::numeric_limits<double>::quiet_NaN();
  };
}

inline RayShape sphere_shape(const glm::dvec3& center_m, double radius_m) {
  return [=](const glm::dvec3& o, const glm::dvec3& d) {
    const glm::dvec3 c = o - center_m;
    const double b = glm::dot(c, d), q = b * b - glm::dot(c, c) + radius_m * radius_m;
    return q >= 0.0 && -b - std::sqrt(q) > 0.0 ? -b - std::sqrt(q)
                                               : std::numeric_limits<double>::quiet_NaN();
  };
}

/// The inside of a box, for cameras in it.
inline RayShape room_shape(const glm::dvec3& min_m, const glm::dvec3& max_m) {
  return [=](const glm::dvec3& o, const glm::dvec3& d) {
    double t = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      if (d[axis] == 0.0) continue;
      t = std::min(t, ((d[axis] > 0.0 ? max_m[axis] : min_m[axis]) - o[axis]) / d[axis]);
    }
    return t;
  };
}

struct ShapeView {
  core::CameraIntrinsics intrinsics;
  core::CameraPose T_world_camera;
  core::Image<float> depth_m;

  [[nodiscard]] DepthView view() const {
    return {intrinsics, T_world_camera, &depth_m, nullptr};
  }
};

inline ShapeView look(const RayShape& shape, const glm::dvec3& eye_m, const glm::dvec3& at_m,
                      double noise_m = 0.0, std::uint64_t seed = 0) {
  ShapeView result;
  result.intrinsics = core::CameraIntrinsics::from_fov(160, 120, std::numbers::pi / 2.0);
  result.T_world_camera = core::look_at(eye_m, at_m);
  result.depth_m = core::Image<float>(160, 120);
  core::RandomStream random(seed, "depth_scenes");
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < 160; ++x) {
      const glm::dvec3 ray = result.intrinsics.back_project({x + 0.5, y + 0.5}, 1.0);
      const double length = glm::length(ray);
      const double t = shape(eye_m, result.T_world_camera.rotation() * (ray / length));
      // Uniform noise of this standard deviation.
      const double noise = noise_m * std::sqrt(3.0) * random.uniform(-1.0, 1.0);
      result.depth_m(x, y) = static_cast<float>(t / length + noise);
    }
  }
  return result;
}

/// From six sides, and some between, all towards the centre.
inline std::vector<ShapeView> look_around(const RayShape& shape, const glm::dvec3& center_m,
                                          double distance_m, double noise_m = 0.0) {
  std::vector<ShapeView> views;
  std::uint64_t seed = 0;
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        if (x == 0 && y == 0) {
          if (z == 0) continue;
          // look_at() needs a direction that is not vertical.
          const glm::dvec3 nearly = glm::normalize(glm::dvec3(0.05, 0.0, z));
          views.push_back(
              look(shape, center_m + distance_m * nearly, center_m, noise_m, ++seed));
          continue;
        }
        const glm::dvec3 side = glm::normalize(glm::dvec3(x, y, z));
        views.push_back(look(shape, center_m + distance_m * side, center_m, noise_m, ++seed));
      }
    }
  }
  return views;
}

/// From one place inside to all sides.
inline std::vector<ShapeView> look_outwards(const RayShape& shape, const glm::dvec3& eye_m,
                                            double noise_m = 0.0, std::uint64_t seed = 0) {
  std::vector<ShapeView> views;
  for (int yaw = 0; yaw < 8; ++yaw) {
    for (const double z : {-1.2, 0.0, 1.2}) {
      const double a = yaw * std::numbers::pi / 4.0;
      views.push_back(look(shape, eye_m, eye_m + glm::dvec3(std::cos(a), std::sin(a), z),
                           noise_m, seed + views.size()));
    }
  }
  for (const double z : {-1.0, 1.0}) {
    views.push_back(
        look(shape, eye_m, eye_m + glm::dvec3(0.02, 0.0, z), noise_m, seed + views.size()));
  }
  return views;
}

inline sim::TriangleMesh fused(const std::vector<ShapeView>& views,
                               const DepthFusionOptions& options = {}) {
  DepthFusion fusion(options);
  for (const ShapeView& view : views) fusion.add(view.view());
  return fusion.surface();
}

}  // namespace segsim::worlds
