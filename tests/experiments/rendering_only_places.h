#pragma once

// Recordings of places in which nothing drives, or not every robot.

#include <cmath>
#include <numbers>
#include <vector>

#include "core/frames.h"
#include "tests/experiments/surfel_room.h"

namespace segsim::experiments {

/// Half the width of the corridor: room for a TurtleBot, not for a Jackal.
inline constexpr double kCorridorHalf_m = 0.40;

/// A corridor of 10 m along x, 1.6 m high, that ends in a box of the class kBoxClass.
inline renderer::SurfelCloud corridor() {
  constexpr double h = kCorridorHalf_m;
  renderer::SurfelCloud cloud;
  const auto patch = [&](const glm::dvec3& corner, const glm::dvec3& u, const glm::dvec3& v,
                         std::uint16_t id) {
    internal::append_patch(cloud, corner, u, v, id);
  };
  patch({-5, -h, 0}, {10, 0, 0}, {0, 2 * h, 0}, kShellClass);
  patch({-5, -h, 0}, {0, 0, 1.6}, {10, 0, 0}, kShellClass);
  patch({-5, h, 0}, {10, 0, 0}, {0, 0, 1.6}, kShellClass);
  patch({-5, -h, 0}, {0, 2 * h, 0}, {0, 0, 1.6}, kShellClass);
  patch({5, -h, 0}, {0, 0, 0.8}, {0, 2 * h, 0}, kBoxClass);
  return cloud;
}

/// From along the corridor, both ways and to both sides, down to the floor.
inline std::vector<core::CameraPose> corridor_views() {
  std::vector<core::CameraPose> poses;
  for (double x = -4.5; x <= 4.5; x += 1.0) {
    const glm::dvec3 eye(x, 0.0, 1.1);
    for (int k = 0; k < 4; ++k) {
      const double a = std::numbers::pi / 2.0 * (k + 0.02);
      for (const double down : {0.3, 1.5}) {
        poses.push_back(core::look_at(eye, eye + glm::dvec3(std::cos(a), std::sin(a), -down)));
      }
    }
  }
  return poses;
}

/// Two walls in a corner that nobody saw below 0.6 m, in heights that mean nothing.
inline renderer::SurfelCloud walls_alone() {
  renderer::SurfelCloud cloud;
  internal::append_patch(cloud, {-2, 1.5, 0.6}, {4, 0, 0}, {0, 0, 1.6}, kShellClass);
  internal::append_patch(cloud, {2, -1.5, 0.6}, {0, 0, 1.6}, {0, 3, 0}, kBoxClass);
  return cloud;
}

inline std::vector<core::CameraPose> wall_views() {
  std::vector<core::CameraPose> poses;
  for (double y = -1.0; y <= 0.5; y += 0.25) {
    poses.push_back(core::look_at({-0.5, y, 1.3}, {1.9, 1.4, 1.2}));
    poses.push_back(core::look_at({-1.0, y, 1.5}, {1.0, 1.4, 1.4}));
  }
  return poses;
}

}  // namespace segsim::experiments
