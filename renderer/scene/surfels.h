#pragma once

/// @file
/// The scene as 2-D Gaussian surfels: discs p(u, v) = p + s_u t_u u + s_v t_v v with density
/// exp(-(u^2 + v^2) / 2) and opacity o (paper, "Preliminaries"; Huang et al. 2024).

#include <cstdint>
#include <string>
#include <vector>

#include <glm/gtc/quaternion.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "core/render.h"

namespace segsim::renderer {

/// Structure of arrays, all of length size(); values are activated (metres, not logarithms).
struct SurfelCloud {
  std::vector<glm::vec3> position_m;      ///< World frame.
  std::vector<glm::quat> R_world_surfel;  ///< Unit; columns t_u, t_v, normal.
  std::vector<glm::vec2> scale_m;         ///< (s_u, s_v) > 0.
  std::vector<float> opacity;             ///< (0, 1].
  int sh_degree = 0;                      ///< 0 ... 3.
  /// Spherical-harmonic coefficients, [size() * (sh_degree + 1)^2], coefficient-major per
  /// surfel: surfel i owns sh[i * n] ... sh[i * n + n - 1], n = (sh_degree + 1)^2; each is (R,
  /// G, B). Colour = 0.5 + sum, in sRGB [0, 1].
  std::vector<glm::vec3> sh;
  std::vector<std::uint16_t>
      semantic_id;  ///< Class, 0 = void. Empty if the scene has no labels.
  std::vector<std::uint16_t> instance_id;  ///< 0 = none. Empty like semantic_id.
  /// Of a trained panoptic field; empty if the scene has none.
  std::vector<core::SemanticFeature> semantic_feature;
  std::vector<core::InstanceFeature> instance_feature;

  [[nodiscard]] std::size_t size() const { return position_m.size(); }
  [[nodiscard]] std::size_t sh_count() const {
    return static_cast<std::size_t>(sh_degree + 1) * static_cast<std::size_t>(sh_degree + 1);
  }
  [[nodiscard]] bool has_labels() const { return !semantic_id.empty(); }
  [[nodiscard]] bool has_features() const { return !semantic_feature.empty(); }
};

/// SH basis constant of degree 0: colour = 0.5 + kShC0 * coefficient.
inline constexpr float kShC0 = 0.28209479177387814F;

/// Refuses arrays of different lengths and values outside the ranges above.
/// @throws core::ContractViolation naming the surfel.
void check_surfels(const SurfelCloud& surfels);

}  // namespace segsim::renderer
