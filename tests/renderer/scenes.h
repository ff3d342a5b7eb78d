#pragma once

/// @file
/// Surfel scenes for tests and benchmarks.

#include <array>
#include <cmath>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "core/random.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer::testing {

struct Surfel {
  glm::vec3 position_m{0.0F};
  glm::quat R_world_surfel{1.0F, 0.0F, 0.0F, 0.0F};
  glm::vec2 scale_m{0.1F};
  float opacity = 0.9F;
  glm::vec3 colour{0.5F};
  std::uint16_t semantic = 1, instance = 1;
};

/// Appends to a scene of degree 0 with labels.
inline void add(SurfelCloud& cloud, const Surfel& surfel) {
  cloud.position_m.push_back(surfel.position_m);
  cloud.R_world_surfel.push_back(glm::normalize(surfel.R_world_surfel));
  cloud.scale_m.push_back(surfel.scale_m);
  cloud.opacity.push_back(surfel.opacity);
  cloud.sh.push_back((surfel.colour - 0.5F) / kShC0);
  cloud.semantic_id.push_back(surfel.semantic);
  cloud.instance_id.push_back(surfel.instance);
}

inline glm::quat random_rotation(core::RandomStream& random) {
  const auto n = [&] { return static_cast<float>(random.normal()); };
  const float w = n(), x = n(), y = n(), z = n();
  return glm::normalize(glm::quat(w, x, y, z));
}

/// Rotation whose normal (third axis) is `normal`, turned about it by `spin_rad`.
inline glm::quat facing(const glm::vec3& normal, float spin_rad = 0.0F) {
  const glm::vec3 helper =
      std::abs(normal.z) > 0.9F ? glm::vec3(1.0F, 0.0F, 0.0F) : glm::vec3(0.0F, 0.0F, 1.0F);
  const glm::vec3 u = glm::normalize(glm::cross(helper, normal));
  const glm::quat R = glm::quat_cast(glm::mat3(u, glm::cross(normal, u), normal));
  return glm::normalize(R * glm::angleAxis(spin_rad, glm::vec3(0.0F, 0.0F, 1.0F)));
}

/// Discs of all sizes, shapes and opacities in a box of 4 m about (0, 0, 0): some are edge-on
/// to any camera, some below a pixel, some reach through a camera inside the box.
inline SurfelCloud random_scene(std::uint64_t seed, int count, float opacity_min = 0.02F) {
  core::RandomStream random(seed, "random_scene");
  const auto uniform = [&](double lo, double hi) {
    return static_cast<float>(random.uniform(lo, hi));
  };
  SurfelCloud cloud;
  for (int i = 0; i < count; ++i) {
    Surfel s;
    s.position_m = {uniform(-2.0, 2.0), uniform(-2.0, 2.0), uniform(-2.0, 2.0)};
    s.R_world_surfel = random_rotation(random);
    const float size_m = std::exp(uniform(std::log(0.001), std::log(0.3)));
    s.scale_m = {size_m, size_m * std::exp(uniform(-2.0, 0.0))};
    s.opacity = uniform(opacity_min, 1.0);
    s.colour = {uniform(0.0, 1.0), uniform(0.0, 1.0), uniform(0.0, 1.0)};
    s.semantic = static_cast<std::uint16_t>(random.index(6));
    s.instance = static_cast<std::uint16_t>(random.index(20));
    add(cloud, s);
  }
  return cloud;
}

/// Features as of an untrained field.
inline void add_random_features(SurfelCloud& cloud, std::uint64_t seed) {
  core::RandomStream random(seed, "features");
  cloud.semantic_feature.resize(cloud.size());
  cloud.instance_feature.resize(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    for (float& f : cloud.semantic_feature[i]) f = static_cast<float>(random.normal());
    for (float& f : cloud.instance_feature[i]) f = static_cast<float>(random.normal());
  }
}

/// Covers the rectangle corner + [0, 1] edge_a + [0, 1] edge_b as a lifted depth image would:
/// one nearly opaque surfel per cell of `spacing_m`.
inline void add_rectangle(SurfelCloud& cloud, core::RandomStream& random,
                          const glm::vec3& corner_m, const glm::vec3& edge_a_m,
                          const glm::vec3& edge_b_m, float spacing_m, std::uint16_t semantic,
                          std::uint16_t instance) {
  const glm::vec3 normal = glm::normalize(glm::cross(edge_a_m, edge_b_m));
  const int na = std::max(1, static_cast<int>(std::lround(glm::length(edge_a_m) / spacing_m)));
  const int nb = std::max(1, static_cast<int>(std::lround(glm::length(edge_b_m) / spacing_m)));
  const auto jitter = [&](float size) { return size * static_cast<float>(random.normal()); };
  const float hue = 0.7F * static_cast<float>(instance);
  for (int a = 0; a < na; ++a) {
    for (int b = 0; b < nb; ++b) {
      const float fa = (static_cast<float>(a) + 0.5F) / static_cast<float>(na);
      const float fb = (static_cast<float>(b) + 0.5F) / static_cast<float>(nb);
      Surfel s;
      s.position_m = corner_m + fa * edge_a_m + fb * edge_b_m + jitter(0.002F) * normal;
      s.R_world_surfel = facing(
          glm::normalize(normal + glm::vec3(jitter(0.05F), jitter(0.05F), jitter(0.05F))));
      s.scale_m = glm::vec2(0.75F * spacing_m * std::exp(jitter(0.1F)));
      s.opacity = 0.95F;
      const float shade = 0.8F + 0.1F * std::sin(9.0F * fa) * std::cos(7.0F * fb);
      s.colour =
          shade * glm::vec3(0.6F + 0.35F * std::sin(hue), 0.6F + 0.35F * std::sin(hue + 2),
                            0.6F + 0.35F * std::sin(hue + 4));
      s.semantic = semantic;
      s.instance = instance;
      add(cloud, s);
    }
  }
}

/// A room of 6 x 5 x 2.7 m with furniture, floor at z = 0; 2 cm of spacing give 0.39 million
/// surfels. Labels: 1 floor, 2 ceiling, 3 walls, 4 furniture with an instance each.
inline SurfelCloud room_scene(float spacing_m, int furniture = 14) {
  core::RandomStream random(7, "room_scene");
  SurfelCloud cloud;
  const glm::vec3 x(6.0F, 0.0F, 0.0F), y(0.0F, 5.0F, 0.0F), z(0.0F, 0.0F, 2.7F), o(0.0F);
  add_rectangle(cloud, random, o, x, y, spacing_m, 1, 1);
  add_rectangle(cloud, random, o + z, y, x, spacing_m, 2, 2);
  add_rectangle(cloud, random, o, z, x, spacing_m, 3, 3);
  add_rectangle(cloud, random, o + y, x, z, spacing_m, 3, 4);
  add_rectangle(cloud, random, o, y, z, spacing_m, 3, 5);
  add_rectangle(cloud, random, o + x, z, y, spacing_m, 3, 6);
  for (int i = 0; i < furniture; ++i) {
    const auto uniform = [&](double lo, double hi) {
      return static_cast<float>(random.uniform(lo, hi));
    };
    const float w = uniform(0.3, 1.2), d = uniform(0.3, 0.9), h = uniform(0.4, 1.5);
    const glm::vec3 a(w, 0.0F, 0.0F), b(0.0F, d, 0.0F), c(0.0F, 0.0F, h);
    // Along the walls, so that the middle stays free for cameras.
    const bool along_x = random.chance(0.5);
    const bool far_side = random.chance(0.5);
    const glm::vec3 at = along_x
                             ? glm::vec3(uniform(0.1, 4.7), far_side ? 4.9F - d : 0.1F, 0.0F)
                             : glm::vec3(far_side ? 5.9F - w : 0.1F, uniform(0.1, 4.0), 0.0F);
    const auto id = static_cast<std::uint16_t>(7 + i);
    add_rectangle(cloud, random, at + c, a, b, spacing_m, 4, id);
    add_rectangle(cloud, random, at, a, c, spacing_m, 4, id);
    add_rectangle(cloud, random, at + b, c, a, spacing_m, 4, id);
    add_rectangle(cloud, random, at, c, b, spacing_m, 4, id);
    add_rectangle(cloud, random, at + a, b, c, spacing_m, 4, id);
  }
  return cloud;
}

}  // namespace segsim::renderer::testing
