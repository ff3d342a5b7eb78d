#include "worlds/mesh/gazebo/internal/primitive_shapes.h"

#include <cmath>
#include <numbers>
#include <utility>

#include <glm/geometric.hpp>

namespace segsim::worlds::internal {
namespace {

/// A grid of vertices (columns + 1) x (rows + 1) as triangles; those without area are left
/// out. `at(u, v)` returns position and normal for u, v in [0, 1]; u x v points outwards.
template <class Surface>
void add_patch(MeshPart& part, int columns, int rows, const Surface& at) {
  const auto first = static_cast<unsigned int>(part.positions.size());
  for (int row = 0; row <= rows; ++row) {
    for (int column = 0; column <= columns; ++column) {
      const double u = static_cast<double>(column) / columns;
      const double v = static_cast<double>(row) / rows;
      const std::pair<glm::dvec3, glm::dvec3> point = at(u, v);
      part.positions.emplace_back(point.first);
      part.normals.emplace_back(point.second);
      part.uvs.emplace_back(u, v);
    }
  }
  const auto add = [&](unsigned int a, unsigned int b, unsigned int c) {
    const glm::vec3& p = part.positions[a];
    const glm::vec3 cross = glm::cross(part.positions[b] - p, part.positions[c] - p);
    if (glm::dot(cross, cross) > 0.0F) part.triangles.emplace_back(a, b, c);
  };
  const auto stride = static_cast<unsigned int>(columns) + 1U;
  for (unsigned int row = 0; row < static_cast<unsigned int>(rows); ++row) {
    for (unsigned int column = 0; column + 1U < stride; ++column) {
      const unsigned int a = first + row * stride + column;
      add(a, a + 1U, a + stride + 1U);
      add(a, a + stride + 1U, a + stride);
    }
  }
}

/// A sphere whose upper half is moved up by `rise_m`, its lower half down.
MeshPart stretched_sphere(double radius_m, double rise_m) {
  MeshPart part;
  add_patch(part, 48, 24, [&](double u, double v) {
    // The poles are exact, so that their triangles have no area.
    const double polar = std::numbers::pi * (1.0 - v);
    const double ring = v == 0.0 || v == 1.0 ? 0.0 : std::sin(polar);
    const double azimuth = 2.0 * std::numbers::pi * u;
    const glm::dvec3 n(ring * std::cos(azimuth), ring * std::sin(azimuth), std::cos(polar));
    const double sign = v > 0.5 ? 1.0 : -1.0;
    return std::pair(radius_m * n + glm::dvec3(0, 0, sign * rise_m), n);
  });
  return part;
}

}  // namespace

MeshPart sphere(double radius_m) { return stretched_sphere(radius_m, 0.0); }

MeshPart capsule(double radius_m, double length_m) {
  return stretched_sphere(radius_m, 0.5 * length_m);
}

MeshPart cylinder(double radius_m, double length_m) {
  MeshPart part;
  const auto rim = [&](double u) {
    const double azimuth = 2.0 * std::numbers::pi * u;
    return glm::dvec3(std::cos(azimuth), std::sin(azimuth), 0.0);
  };
  add_patch(part, 48, 1, [&](double u, double v) {
    return std::pair(radius_m * rim(u) + glm::dvec3(0, 0, (v - 0.5) * length_m), rim(u));
  });
  for (const double side : {-1.0, 1.0}) {
    add_patch(part, 48, 1, [&](double u, double v) {
      const double inwards = side > 0 ? 1.0 - v : v;
      return std::pair(inwards * radius_m * rim(u) + glm::dvec3(0, 0, 0.5 * side * length_m),
                       glm::dvec3(0, 0, side));
    });
  }
  return part;
}

MeshPart box(const glm::dvec3& size_m) {
  MeshPart part;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      glm::dvec3 n(0.0);
      n[axis] = side;
      glm::dvec3 edge_u(0.0);
      edge_u[(axis + 1) % 3] = 1.0;
      const glm::dvec3 edge_v = glm::cross(n, edge_u);
      add_patch(part, 1, 1, [&](double u, double v) {
        return std::pair(0.5 * size_m * (n + (2 * u - 1) * edge_u + (2 * v - 1) * edge_v), n);
      });
    }
  }
  return part;
}

MeshPart plane(const glm::dvec3& normal, double width_m, double height_m) {
  MeshPart part;
  const glm::dvec3 hint = std::abs(normal.x) > 0.5 ? glm::dvec3(0, 1, 0) : glm::dvec3(1, 0, 0);
  const glm::dvec3 edge_v = glm::normalize(glm::cross(normal, hint));
  const glm::dvec3 edge_u = glm::cross(edge_v, normal);
  add_patch(part, 1, 1, [&](double u, double v) {
    return std::pair((u - 0.5) * width_m * edge_u + (v - 0.5) * height_m * edge_v, normal);
  });
  return part;
}

}  // namespace segsim::worlds::internal
