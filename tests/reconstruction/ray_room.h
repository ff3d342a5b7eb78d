#pragma once

/// @file
/// Rooms made of rectangles, and depth images of them by ray casting: ground truth for what is
/// found out about a recording's world.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"
#include "core/random.h"

namespace segsim::reconstruction::testing {

/// corner + s side + t other, s and t in [0, 1].
struct Rectangle {
  glm::dvec3 corner_m, side_m, other_m;
};

/// z up, floor at z = 0.
struct RayRoom {
  std::vector<Rectangle> rectangles;
  std::vector<core::CameraPose> cameras;

  void add(const glm::dvec3& corner_m, const glm::dvec3& side_m, const glm::dvec3& other_m) {
    rectangles.push_back({corner_m, side_m, other_m});
  }
  /// Four walls from `low` to `high`.
  void add_walls(const glm::dvec3& low, const glm::dvec3& high) {
    const glm::dvec3 x(high.x - low.x, 0, 0), y(0, high.y - low.y, 0), z(0, 0, high.z - low.z);
    add(low, x, z), add(low, y, z), add(low + x, y, z), add(low + y, x, z);
  }
  void add_slab(const glm::dvec3& low, double width_m, double depth_m) {
    add(low, {width_m, 0, 0}, {0, depth_m, 0});
  }
  void add_box(const glm::dvec3& low, const glm::dvec3& high) {
    add_walls(low, high);
    add_slab({low.x, low.y, high.z}, high.x - low.x, high.y - low.y);
  }
  /// Held by hand in the middle of x in [x0, x1], y in [y0, y1], `height_m` above z = 0:
  /// looking all around, 20 degrees down on average, and rolled by up to 5 degrees.
  void walk(const glm::dvec2& from_m, const glm::dvec2& to_m, double height_m, int views,
            double down_rad = 0.35) {
    for (int i = 0; i < views; ++i) {
      const double t = (i + 0.5) / views, heading = 2.4 * i;
      const double pitch = down_rad + 0.25 * std::sin(1.7 * i),
                   roll = 0.09 * std::sin(2.9 * i);
      const glm::dvec3 eye(glm::mix(from_m, to_m, t), height_m + 0.1 * std::sin(1.1 * i));
      const glm::dvec3 ahead(std::cos(heading) * std::cos(pitch),
                             std::sin(heading) * std::cos(pitch), -std::sin(pitch));
      const core::CameraPose level = core::look_at(eye, eye + ahead);
      cameras.emplace_back(level.rotation() * glm::angleAxis(roll, glm::dvec3(0, 0, 1)), eye);
    }
  }
};

/// Distance along the ray in units of `ray`; infinite if it passes.
inline double hit(const Rectangle& r, const glm::dvec3& eye, const glm::dvec3& ray) {
  const glm::dvec3 normal = glm::cross(r.side_m, r.other_m);
  const double along = glm::dot(normal, ray);
  const double t = std::abs(along) < 1e-12 ? -1.0 : glm::dot(normal, r.corner_m - eye) / along;
  const glm::dvec3 at = eye + t * ray - r.corner_m;
  const double u = glm::dot(at, r.side_m) / glm::dot(r.side_m, r.side_m);
  const double v = glm::dot(at, r.other_m) / glm::dot(r.other_m, r.other_m);
  const bool inside = t > 1e-6 && u >= 0.0 && u <= 1.0 && v >= 0.0 && v <= 1.0;
  return inside ? t : std::numeric_limits<double>::infinity();
}

/// Depth along +z with noise that grows with its square, as that of structured light does;
/// NaN where nothing is.
inline core::Image<float> draw_depth(const RayRoom& room, const core::CameraPose& camera,
                                     const core::CameraIntrinsics& intrinsics,
                                     core::RandomStream& random) {
  core::Image<float> depth_m(intrinsics.width_px, intrinsics.height_px, std::nanf(""));
  for (int y = 0; y < intrinsics.height_px; ++y) {
    for (int x = 0; x < intrinsics.width_px; ++x) {
      const glm::dvec3 ray =
          camera.rotation() * intrinsics.back_project({x + 0.5, y + 0.5}, 1.0);
      double z = std::numeric_limits<double>::infinity();
      for (const Rectangle& r : room.rectangles) {
        z = std::min(z, hit(r, camera.translation_m(), ray));
      }
      if (!(z < 8.0)) continue;
      depth_m(x, y) = static_cast<float>(z + 0.002 * z * z * random.normal());
    }
  }
  return depth_m;
}

/// What of a room is left out.
struct RoomParts {
  bool floor = true, ceiling = true, furniture = true;
};

/// 5 m x 4 m x 2.6 m with a table, a cupboard, a couch and a board that leans on a wall.
inline RayRoom living_room(const RoomParts& parts = {}) {
  RayRoom room;
  room.add_walls({0, 0, 0}, {5, 4, 2.6});
  if (parts.floor) room.add_slab({0, 0, 0}, 5, 4);
  if (parts.ceiling) room.add_slab({0, 0, 2.6}, 5, 4);
  if (parts.furniture) {
    room.add_slab({1.5, 1.4, 0.75}, 1.4, 0.8);
    room.add_box({4.4, 0.5, 0}, {5, 2.1, 1.9});
    room.add_box({0.2, 3.1, 0}, {2.2, 3.9, 0.45});
    room.add({0.3, 0.1, 0}, {0.9, 0, 0}, {0, -0.08 + 0.6, 1.6});
  }
  room.walk({3.2, 1.2}, {3.6, 3.0}, 1.5, 24);
  return room;
}

}  // namespace segsim::reconstruction::testing
