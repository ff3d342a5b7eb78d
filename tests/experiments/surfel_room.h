#pragma once

/// @file
/// A room of 4 m x 3 m x 2.4 m with a box in it, as surfels and as the triangles that they lie
/// on.

#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "core/frames.h"
#include "renderer/scene/surfels.h"
#include "sim/ground/triangle_mesh.h"
#include "tests/box_mesh.h"

namespace segsim::experiments {

inline constexpr std::uint16_t kShellClass = 1, kBoxClass = 2;

namespace internal {

/// A rectangle of surfels 4 cm apart that face u x v.
inline void append_patch(renderer::SurfelCloud& cloud, const glm::dvec3& corner,
                         const glm::dvec3& u, const glm::dvec3& v, std::uint16_t class_id) {
  constexpr double kStep_m = 0.04;
  const int n = static_cast<int>(std::ceil(glm::length(u) / kStep_m));
  const int m = static_cast<int>(std::ceil(glm::length(v) / kStep_m));
  const glm::dvec3 x = glm::normalize(u), y = glm::normalize(v);
  const glm::quat R(glm::quat_cast(glm::dmat3(x, y, glm::cross(x, y))));
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < m; ++j) {
      cloud.position_m.emplace_back(corner + u * ((i + 0.5) / n) + v * ((j + 0.5) / m));
      cloud.R_world_surfel.push_back(R);
      cloud.scale_m.emplace_back(0.03F, 0.03F);
      cloud.opacity.push_back(0.95F);
      const auto shade = static_cast<float>(0.4 * std::sin(0.9 * i) * std::cos(0.7 * j));
      cloud.sh.emplace_back(shade, -shade, class_id == kBoxClass ? 1.0F : -0.5F);
      cloud.semantic_id.push_back(class_id);
      cloud.instance_id.push_back(class_id == kBoxClass ? 1 : 0);
    }
  }
}

}  // namespace internal

inline renderer::SurfelCloud surfel_room() {
  renderer::SurfelCloud cloud;
  const auto patch = [&](const glm::dvec3& corner, const glm::dvec3& u, const glm::dvec3& v,
                         std::uint16_t id) {
    internal::append_patch(cloud, corner, u, v, id);
  };
  patch({-2, -1.5, 0}, {4, 0, 0}, {0, 3, 0}, kShellClass);
  patch({-2, -1.5, 2.4}, {0, 3, 0}, {4, 0, 0}, kShellClass);
  patch({-2, -1.5, 0}, {0, 3, 0}, {0, 0, 2.4}, kShellClass);
  patch({2, -1.5, 0}, {0, 0, 2.4}, {0, 3, 0}, kShellClass);
  patch({-2, -1.5, 0}, {0, 0, 2.4}, {4, 0, 0}, kShellClass);
  patch({-2, 1.5, 0}, {4, 0, 0}, {0, 0, 2.4}, kShellClass);
  patch({1.2, 0.7, 0.6}, {0.8, 0, 0}, {0, 0.8, 0}, kBoxClass);
  patch({1.2, 0.7, 0}, {0, 0, 0.6}, {0, 0.8, 0}, kBoxClass);
  patch({1.2, 0.7, 0}, {0.8, 0, 0}, {0, 0, 0.6}, kBoxClass);
  return cloud;
}

inline sim::TriangleMesh room_triangles() {
  sim::TriangleMesh mesh;
  sim::append_floor(mesh, -2, -1.5, 2, 1.5);
  sim::append_box(mesh, {1.2F, 0.7F, 0.0F}, {2.0F, 1.5F, 0.6F});
  sim::append_box(mesh, {-2.2F, -1.7F, 0.0F}, {-2.0F, 1.7F, 2.4F});
  sim::append_box(mesh, {2.0F, -1.7F, 0.0F}, {2.2F, 1.7F, 2.4F});
  sim::append_box(mesh, {-2.0F, -1.7F, 0.0F}, {2.0F, -1.5F, 2.4F});
  sim::append_box(mesh, {-2.0F, 1.5F, 0.0F}, {2.0F, 1.7F, 2.4F});
  return mesh;
}

/// From three places, to all sides and down.
inline std::vector<core::CameraPose> room_views(int per_place = 8) {
  std::vector<core::CameraPose> poses;
  for (const glm::dvec3& eye :
       {glm::dvec3(-0.9, 0.2, 1.2), {0.4, -0.7, 1.3}, {0.3, 0.5, 1.1}}) {
    for (int k = 0; k < per_place; ++k) {
      const double a = 2.0 * std::numbers::pi * (k + 0.1) / per_place;
      poses.push_back(core::look_at(
          eye, eye + glm::dvec3(std::cos(a), std::sin(a), k % 2 == 0 ? -0.7 : 0.1)));
    }
  }
  return poses;
}

}  // namespace segsim::experiments
