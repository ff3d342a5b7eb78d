#pragma once

/// @file
/// How far images and gradients are from the reference, and scenes with long lists.

#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "core/random.h"
#include "tests/reconstruction/training/training_surfels.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer::testing {

/// Relative, in the Euclidean norm.
inline double relative_error(const std::vector<float>& a, const std::vector<double>& b) {
  double difference = 0.0, norm = 0.0;
  for (std::size_t i = 0; i < b.size(); ++i) {
    const double d = static_cast<double>(a[i]) - b[i];
    difference += d * d, norm += b[i] * b[i];
  }
  // Not a number in `a` must not pass.
  return norm > 0.0 ? std::sqrt(difference / norm) : difference == 0.0 ? 0.0 : 1e9;
}

/// Share of elements farther than `tolerance` from the reference's.
inline double share_off(const std::vector<float>& a, const std::vector<double>& b,
                        double tolerance) {
  std::size_t off = 0;
  for (std::size_t i = 0; i < b.size(); ++i) {
    const double allowed = tolerance * (1.0 + std::abs(b[i]));
    off += !(std::abs(static_cast<double>(a[i]) - b[i]) <= allowed) ? 1U : 0U;
  }
  return b.empty() ? 0.0 : static_cast<double>(off) / static_cast<double>(b.size());
}

template <class A>
std::vector<std::pair<const char*, const A*>> arrays_of(
    const reconstruction::testing::OwnedGradients<typename A::value_type>& g) {
  return {{"position", &g.position_m},   {"scale", &g.log_scale}, {"rotation", &g.rotation},
          {"opacity", &g.opacity_logit}, {"sh", &g.sh},           {"screen", &g.screen}};
}

template <class A>
std::vector<std::pair<const char*, const A*>> arrays_of(
    const reconstruction::testing::OwnedImages<typename A::value_type>& i) {
  return {{"rgb", &i.rgb},       {"depth", &i.depth_m},   {"alpha", &i.alpha},
          {"normal", &i.normal}, {"median", &i.median_m}, {"distortion", &i.distortion}};
}

inline bool equal_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0);
}

/// Faint discs one behind the other before a few tiles: lists longer than any buffer.
inline SurfelCloud stack(int count, float opacity) {
  core::RandomStream random(5, "stack");
  SurfelCloud cloud;
  for (int i = 0; i < count; ++i) {
    const auto u = [&] { return static_cast<float>(random.uniform()); };
    Surfel s;
    s.position_m = {u() - 0.5F, u() - 0.5F, 2.0F + 6.0F * u()};
    s.scale_m = {0.05F + 0.2F * u(), 0.05F + 0.2F * u()};
    s.R_world_surfel = random_rotation(random);
    s.opacity = opacity * (0.5F + u());
    s.colour = {u(), u(), u()};
    add(cloud, s);
  }
  return cloud;
}

/// Discs at exactly one depth: their index decides.
inline SurfelCloud ties(int count) {
  core::RandomStream random(6, "ties");
  SurfelCloud cloud;
  for (int i = 0; i < count; ++i) {
    const auto u = [&] { return static_cast<float>(random.uniform()); };
    add(cloud, {.position_m = {u() - 0.5F, u() - 0.5F, 2.0F},
                .scale_m = glm::vec2(0.05F + 0.1F * u()),
                .opacity = 0.05F + 0.5F * u(),
                .colour = {u(), u(), u()}});
  }
  return cloud;
}

}  // namespace segsim::renderer::testing
