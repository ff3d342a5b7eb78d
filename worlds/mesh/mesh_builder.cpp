#include "worlds/mesh/mesh_builder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>

#include "core/check.h"

namespace segsim::worlds {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
/// Twice the area below which a triangle is dropped: sides of some 0.1 mm.
constexpr float kMinDoubleArea_m2 = 1e-8F;
constexpr float kSharpEdgeCosine = 0.766F;  // 40 degrees.
constexpr float kLeafHalfThickness_m = 0.002F;

glm::vec2 perpendicular(const glm::vec2& v) { return {v.y, -v.x}; }

}  // namespace

glm::mat4 pose_matrix(const glm::vec3& position_m, float yaw_rad) {
  return turned_matrix(position_m, {0.0F, 0.0F, 1.0F}, yaw_rad);
}

glm::mat4 turned_matrix(const glm::vec3& position_m, const glm::vec3& axis, float angle_rad) {
  return glm::rotate(glm::translate(glm::mat4(1.0F), position_m), angle_rad, axis);
}

void MeshBuilder::set_surface(const Surface& surface) {
  SEGSIM_CHECK(surface.tile_m > 0.0F, "tile_m");
  tile_m_ = surface.tile_m;
  for (std::size_t i = 0; i < groups_.size(); ++i) {
    if (groups_[i].material == surface.material) {
      current_ = i;
      return;
    }
  }
  groups_.emplace_back().material = surface.material;
  current_ = groups_.size() - 1;
}

std::uint32_t MeshBuilder::add_vertex(const Vertex& part_vertex) {
  SEGSIM_CHECK(!groups_.empty(), "set_surface comes first");
  sim::SubMesh& mesh = group();
  const glm::vec3& p =
      mesh.positions_m.emplace_back(T_object_part_ * glm::vec4(part_vertex.position_m, 1.0F));
  low_m_ = glm::min(low_m_, p);
  high_m_ = glm::max(high_m_, p);
  mesh.normals.push_back(
      glm::normalize(glm::vec3(T_object_part_ * glm::vec4(part_vertex.normal, 0.0F))));
  mesh.uvs.push_back(part_vertex.uv);
  return static_cast<std::uint32_t>(mesh.positions_m.size() - 1);
}

/// Turns the triangle to the side that its normals look to.
void MeshBuilder::add_triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  sim::SubMesh& mesh = group();
  const auto& p = mesh.positions_m;
  const glm::vec3 cross = glm::cross(p[b] - p[a], p[c] - p[a]);
  SEGSIM_CHECK(std::isfinite(glm::length(cross)), "vertex is not finite");
  if (glm::length(cross) < kMinDoubleArea_m2) return;
  const glm::vec3 outward = mesh.normals[a] + mesh.normals[b] + mesh.normals[c];
  if (glm::dot(cross, outward) < 0.0F) std::swap(b, c);
  mesh.triangles.emplace_back(a, b, c);
}

void MeshBuilder::add_cell(std::uint32_t a, std::uint32_t b, std::uint32_t c,
                           std::uint32_t d) {
  add_triangle(a, b, c);
  add_triangle(a, c, d);
}

void MeshBuilder::add_quad(const glm::vec3& origin_m, const glm::vec3& edge_u_m,
                           const glm::vec3& edge_v_m, bool stretched) {
  const glm::vec3 normal = glm::normalize(glm::cross(edge_u_m, edge_v_m));
  const float u = stretched ? 1.0F : glm::length(edge_u_m) / tile_m_;
  const float v = stretched ? 1.0F : glm::length(edge_v_m) / tile_m_;
  const std::uint32_t a = add_vertex({origin_m, normal, {0.0F, 0.0F}});
  const std::uint32_t b = add_vertex({origin_m + edge_u_m, normal, {u, 0.0F}});
  const std::uint32_t c = add_vertex({origin_m + edge_u_m + edge_v_m, normal, {u, v}});
  const std::uint32_t d = add_vertex({origin_m + edge_v_m, normal, {0.0F, v}});
  add_cell(a, b, c, d);
}

void MeshBuilder::add_box(const glm::vec3& center_m, const glm::vec3& size_m) {
  const glm::vec3 low = center_m - 0.5F * size_m, high = center_m + 0.5F * size_m;
  const glm::vec3 x(size_m.x, 0, 0), y(0, size_m.y, 0), z(0, 0, size_m.z);
  add_quad(low, x, z);                       // -y
  add_quad({high.x, high.y, low.z}, -x, z);  // +y
  add_quad({low.x, high.y, low.z}, -y, z);   // -x
  add_quad({high.x, low.y, low.z}, y, z);    // +x
  add_quad({low.x, low.y, high.z}, x, y);    // +z
  add_quad({low.x, high.y, low.z}, x, -y);   // -z
}

void MeshBuilder::add_rounded_box(const glm::vec3& center_m, const glm::vec3& size_m,
                                  float radius_m, int segments) {
  const glm::vec3 half = 0.5F * size_m;
  const float radius = std::min(radius_m, 0.999F * std::min({half.x, half.y, half.z}));
  const glm::vec3 inner = half - radius;
  // Offsets from the inner box along one axis: equal angles from the corner to the flat
  // middle.
  const auto stations = [&](float inner_half) {
    std::vector<float> s;
    for (int i = 0; i <= segments; ++i) {
      const float angle =
          0.25F * kPi * static_cast<float>(segments - i) / static_cast<float>(segments);
      s.push_back(-inner_half - radius * std::tan(angle));
    }
    for (int i = segments; i >= 0; --i) s.push_back(-s[static_cast<std::size_t>(i)]);
    return s;
  };
  for (int face = 0; face < 6; ++face) {
    const int axis = face / 2, axis_u = (axis + 1) % 3, axis_v = (axis + 2) % 3;
    const float side = face % 2 == 0 ? 1.0F : -1.0F;
    const std::vector<float> us = stations(inner[axis_u]), vs = stations(inner[axis_v]);
    const auto columns = static_cast<std::uint32_t>(us.size());
    std::uint32_t first = 0;
    for (std::size_t j = 0; j < vs.size(); ++j) {
      for (std::size_t i = 0; i < us.size(); ++i) {
        glm::vec3 on_cube(0.0F), core(0.0F);
        on_cube[axis] = side * half[axis];
        on_cube[axis_u] = us[i];
        on_cube[axis_v] = vs[j];
        core = glm::clamp(on_cube, -inner, inner);
        const glm::vec3 normal = glm::normalize(on_cube - core);
        const std::uint32_t v = add_vertex(
            {center_m + core + radius * normal, normal, glm::vec2(us[i], vs[j]) / tile_m_});
        if (i == 0 && j == 0) first = v;
      }
    }
    for (std::uint32_t j = 0; j + 1 < vs.size(); ++j) {
      for (std::uint32_t i = 0; i + 1 < columns; ++i) {
        const std::uint32_t a = first + j * columns + i;
        add_cell(a, a + 1, a + columns + 1, a + columns);
      }
    }
  }
}

void MeshBuilder::add_cylinder(const glm::vec3& from_m, const glm::vec3& to_m,
                               float radius_from_m, float radius_to_m, int segments) {
  const float length = glm::length(to_m - from_m);
  const glm::vec3 axis = (to_m - from_m) / length;
  const glm::vec3 helper = std::abs(axis.z) < 0.9F ? glm::vec3(0, 0, 1) : glm::vec3(1, 0, 0);
  const glm::vec3 side = glm::normalize(glm::cross(helper, axis));
  const glm::mat4 outer = T_object_part_;
  const glm::mat4 along(glm::vec4(side, 0), glm::vec4(glm::cross(axis, side), 0),
                        glm::vec4(axis, 0), glm::vec4(from_m, 1));
  T_object_part_ = outer * along;
  std::vector<glm::vec2> profile{{0.0F, 0.0F}};
  if (radius_from_m > 0.0F) profile.emplace_back(radius_from_m, 0.0F);
  if (radius_to_m > 0.0F) profile.emplace_back(radius_to_m, length);
  profile.emplace_back(0.0F, length);
  add_lathe(glm::vec3(0.0F), profile, segments);
  T_object_part_ = outer;
}

void MeshBuilder::add_ellipsoid(const glm::vec3& center_m, const glm::vec3& radii_m,
                                int segments) {
  const int rings = std::max(3, segments / 2);
  const auto columns = static_cast<std::uint32_t>(segments) + 1U;
  std::uint32_t first = 0;
  for (int j = 0; j <= rings; ++j) {
    const float polar = kPi * static_cast<float>(j) / static_cast<float>(rings);
    const float across =
        j == 0 || j == rings ? 0.0F : std::sin(polar);  // Exactly 0 at the poles.
    for (int i = 0; i <= segments; ++i) {
      const float angle =
          2.0F * kPi * static_cast<float>(i % segments) / static_cast<float>(segments);
      const glm::vec3 unit(across * std::cos(angle), across * std::sin(angle),
                           -std::cos(polar));
      const glm::vec2 uv(
          2.0F * kPi * radii_m.x * static_cast<float>(i) / static_cast<float>(segments),
          polar * radii_m.z);
      const std::uint32_t v = add_vertex(
          {center_m + unit * radii_m, glm::normalize(unit / radii_m), uv / tile_m_});
      if (i == 0 && j == 0) first = v;
    }
  }
  for (std::uint32_t j = 0; j < static_cast<std::uint32_t>(rings); ++j) {
    for (std::uint32_t i = 0; i + 1 < columns; ++i) {
      const std::uint32_t a = first + j * columns + i;
      add_cell(a, a + 1, a + columns + 1, a + columns);
    }
  }
}

void MeshBuilder::add_lathe(const glm::vec3& base_m, std::span<const glm::vec2> profile_m,
                            int segments, const glm::vec2& scale_xy) {
  const std::size_t count = profile_m.size();
  std::vector<glm::vec2> outward;  // Of each profile segment, (radial, up).
  for (std::size_t k = 0; k + 1 < count; ++k) {
    const glm::vec2 step = profile_m[k + 1] - profile_m[k];
    SEGSIM_CHECK(glm::length(step) > 0.0F, "profile points must differ");
    outward.push_back(glm::normalize(perpendicular(step)));
  }
  float along = 0.0F;
  for (std::size_t k = 0; k + 1 < count; ++k) {
    std::array<glm::vec2, 2> normals{outward[k], outward[k]};
    if (k > 0 && glm::dot(outward[k - 1], outward[k]) > kSharpEdgeCosine) {
      normals[0] = glm::normalize(outward[k - 1] + outward[k]);
    }
    if (k + 2 < count && glm::dot(outward[k + 1], outward[k]) > kSharpEdgeCosine) {
      normals[1] = glm::normalize(outward[k + 1] + outward[k]);
    }
    const float step = glm::length(profile_m[k + 1] - profile_m[k]);
    std::uint32_t first = 0;
    for (std::size_t ring = 0; ring < 2; ++ring) {
      const glm::vec2 p = profile_m[k + ring];
      for (int i = 0; i <= segments; ++i) {
        const float turn = static_cast<float>(i % segments) / static_cast<float>(segments);
        const float c = std::cos(2.0F * kPi * turn), s = std::sin(2.0F * kPi * turn);
        const glm::vec3 position =
            base_m + glm::vec3(p.x * c * scale_xy.x, p.x * s * scale_xy.y, p.y);
        const glm::vec3 normal(normals[ring].x * c / scale_xy.x,
                               normals[ring].x * s / scale_xy.y, normals[ring].y);
        const float widest = std::max(profile_m[k].x, profile_m[k + 1].x);
        const glm::vec2 uv(
            2.0F * kPi * widest * static_cast<float>(i) / static_cast<float>(segments),
            along + static_cast<float>(ring) * step);
        const std::uint32_t v = add_vertex({position, normal, uv / tile_m_});
        if (ring == 0 && i == 0) first = v;
      }
    }
    const auto columns = static_cast<std::uint32_t>(segments) + 1U;
    for (std::uint32_t i = 0; i + 1 < columns; ++i) {
      add_cell(first + i, first + i + 1, first + columns + i + 1, first + columns + i);
    }
    along += step;
  }
}

void MeshBuilder::add_prism(std::span<const glm::vec2> outline_m, float z_from_m,
                            float z_to_m) {
  glm::vec2 mean(0.0F);
  for (const glm::vec2& p : outline_m) mean += p / static_cast<float>(outline_m.size());
  float along = 0.0F;
  for (std::size_t i = 0; i < outline_m.size(); ++i) {
    const glm::vec2 a = outline_m[i], b = outline_m[(i + 1) % outline_m.size()];
    const glm::vec3 side(glm::normalize(perpendicular(b - a)), 0.0F);
    const float next = along + glm::length(b - a);
    const auto corner = [&](const glm::vec2& p, float z, float u) {
      return add_vertex({{p, z}, side, glm::vec2(u, z) / tile_m_});
    };
    const std::uint32_t c0 = corner(a, z_from_m, along), c1 = corner(b, z_from_m, next);
    const std::uint32_t c2 = corner(b, z_to_m, next), c3 = corner(a, z_to_m, along);
    add_cell(c0, c1, c2, c3);
    along = next;
    for (const float z : {z_from_m, z_to_m}) {
      const glm::vec3 cap(0.0F, 0.0F, z == z_to_m ? 1.0F : -1.0F);
      const auto flat = [&](const glm::vec2& p) {
        return add_vertex({{p, z}, cap, p / tile_m_});
      };
      const std::uint32_t v0 = flat(mean), v1 = flat(a), v2 = flat(b);
      add_triangle(v0, v1, v2);
    }
  }
}

void MeshBuilder::add_leaf(const glm::vec3& base_m, const glm::vec3& direction, float length_m,
                           float width_m, float bend, int segments) {
  const glm::vec3 helper =
      std::abs(direction.z) < 0.98F ? glm::vec3(0, 0, 1) : glm::vec3(1, 0, 0);
  const glm::vec3 across = glm::normalize(glm::cross(direction, helper));
  // The spine turns downwards step by step.
  std::vector<glm::vec3> spine{base_m}, up;
  const float step = length_m / static_cast<float>(segments);
  for (int i = 0; i <= segments; ++i) {
    const float turned =
        -0.5F * kPi * bend * static_cast<float>(i) / static_cast<float>(segments);
    const glm::mat4 R = glm::rotate(glm::mat4(1.0F), turned, across);
    const glm::vec3 forward(R * glm::vec4(direction, 0.0F));
    up.push_back(glm::normalize(glm::cross(across, forward)));
    if (i < segments) spine.push_back(spine.back() + step * forward);
  }
  for (const float side : {1.0F, -1.0F}) {
    std::uint32_t first = 0;
    for (int i = 0; i <= segments; ++i) {
      const float t = static_cast<float>(i) / static_cast<float>(segments);
      const float half =
          0.5F * width_m *
          (0.12F + std::pow(std::max(0.0F, std::sin(kPi * (0.08F + 0.92F * t))), 0.7F));
      const auto k = static_cast<std::size_t>(i);
      const glm::vec3 normal = side * up[k];
      const glm::vec3 middle = spine[k] + kLeafHalfThickness_m * normal;
      const glm::vec3 fold = 0.25F * half * up[k];  // The halves rise from the middle rib.
      const std::uint32_t v = add_vertex({spine[k] - half * across + fold, normal, {0.0F, t}});
      if (i == 0) first = v;
      add_vertex({middle, normal, {0.5F, t}});
      add_vertex({spine[k] + half * across + fold, normal, {1.0F, t}});
    }
    for (std::uint32_t i = 0; i < static_cast<std::uint32_t>(segments); ++i) {
      const std::uint32_t a = first + 3 * i;
      add_cell(a, a + 1, a + 4, a + 3);
      add_cell(a + 1, a + 2, a + 5, a + 4);
    }
  }
}

void MeshBuilder::add_mesh(const sim::SubMesh& mesh) {
  const auto first = static_cast<std::uint32_t>(group().positions_m.size());
  for (std::size_t i = 0; i < mesh.positions_m.size(); ++i) {
    add_vertex({mesh.positions_m[i], mesh.normals[i], mesh.uvs[i]});
  }
  for (const glm::uvec3& t : mesh.triangles)
    add_triangle(first + t.x, first + t.y, first + t.z);
}

std::size_t MeshBuilder::triangle_count() const {
  std::size_t count = 0;
  for (const sim::SubMesh& mesh : groups_) count += mesh.triangles.size();
  return count;
}

std::vector<sim::SubMesh> MeshBuilder::build(const glm::mat4& T_world_object,
                                             std::uint16_t class_id,
                                             std::uint16_t instance_id) const {
  std::vector<sim::SubMesh> meshes;
  for (const sim::SubMesh& mesh : groups_) {
    if (mesh.triangles.empty()) continue;
    sim::SubMesh& placed = meshes.emplace_back(mesh);
    placed.class_id = class_id;
    placed.instance_id = instance_id;
    for (glm::vec3& p : placed.positions_m) p = T_world_object * glm::vec4(p, 1.0F);
    for (glm::vec3& n : placed.normals) {
      n = glm::normalize(glm::vec3(T_world_object * glm::vec4(n, 0.0F)));
    }
  }
  return meshes;
}

}  // namespace segsim::worlds
