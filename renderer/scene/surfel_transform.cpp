#include "renderer/scene/surfel_transform.h"

#include <array>
#include <cmath>
#include <vector>

#include "renderer/scene/sphere_quadrature.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer {
namespace {

constexpr int kMostHarmonics = 16;
using HarmonicMatrix = std::array<std::array<double, kMostHarmonics>, kMostHarmonics>;
using Basis = std::array<double, kMostHarmonics>;

Basis basis_at(const glm::dvec3& direction) {
  Basis basis{};
  sh_basis(3, Vec3<double>{direction.x, direction.y, direction.z}, basis.data());
  return basis;
}

/// c' = D c so that the turned function has the old values at the turned directions:
/// D_ij = integral of Y_i(d) Y_j(R^-1 d), a polynomial of degree 6.
HarmonicMatrix harmonic_rotation(const glm::dquat& R) {
  const glm::dquat back = glm::conjugate(R);
  HarmonicMatrix D{};
  for (const internal::SphereNode& node : internal::sphere_quadrature()) {
    const glm::dvec3 d(node.x, node.y, node.z);
    const Basis here = basis_at(d), before = basis_at(back * d);
    for (std::size_t i = 0; i < here.size(); ++i) {
      for (std::size_t j = 0; j < here.size(); ++j) {
        D[i][j] += node.weight * here[i] * before[j];
      }
    }
  }
  return D;
}

void rotate_harmonics(const HarmonicMatrix& D, std::size_t count, glm::vec3* sh) {
  std::array<glm::dvec3, kMostHarmonics> turned{};
  for (std::size_t i = 0; i < count; ++i) {
    // Bands do not mix: band l has the harmonics l^2 ... (l + 1)^2 - 1.
    const auto band = static_cast<std::size_t>(std::sqrt(static_cast<double>(i) + 0.5));
    for (std::size_t j = band * band; j < (band + 1) * (band + 1); ++j) {
      turned[i] += D[i][j] * glm::dvec3(sh[j]);
    }
  }
  for (std::size_t i = 0; i < count; ++i) sh[i] = glm::vec3(turned[i]);
}

}  // namespace

void transform_surfels(const glm::dquat& R, const glm::dvec3& t_m, SurfelCloud& surfels) {
  for (std::size_t i = 0; i < surfels.size(); ++i) {
    surfels.position_m[i] = glm::vec3(R * glm::dvec3(surfels.position_m[i]) + t_m);
    surfels.R_world_surfel[i] =
        glm::quat(glm::normalize(R * glm::dquat(surfels.R_world_surfel[i])));
  }
  if (surfels.sh_degree == 0) return;
  const HarmonicMatrix D = harmonic_rotation(R);
  const std::size_t n = surfels.sh_count();
  for (std::size_t i = 0; i < surfels.size(); ++i) {
    rotate_harmonics(D, n, surfels.sh.data() + i * n);
  }
}

void transform_panoptic_model(const glm::dquat& R, const glm::dvec3& t_m,
                              PanopticModel& model) {
  for (InstanceQuery& query : model.queries) {
    query.position_m = glm::vec3(R * glm::dvec3(query.position_m) + t_m);
    query.R_world_query = glm::quat(glm::normalize(R * glm::dquat(query.R_world_query)));
  }
}

}  // namespace segsim::renderer
