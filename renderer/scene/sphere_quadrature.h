#pragma once

/// @file
/// Integrals over the unit sphere that are exact for polynomials up to degree 7 in x, y, z:
/// four Gauss-Legendre nodes in z, eight equal angles around it. Products of two spherical
/// harmonics of degree 3 have degree 6.

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace segsim::renderer::internal {

struct SphereNode {
  double x, y, z;  ///< Of length 1.
  double weight;   ///< All together 4 pi.
};

[[nodiscard]] inline std::array<SphereNode, 32> sphere_quadrature() {
  const double inner = std::sqrt(3.0 / 7.0 - 2.0 / 7.0 * std::sqrt(1.2));
  const double outer = std::sqrt(3.0 / 7.0 + 2.0 / 7.0 * std::sqrt(1.2));
  const double heavy = (18.0 + std::sqrt(30.0)) / 36.0,
               light = (18.0 - std::sqrt(30.0)) / 36.0;
  const std::array<double, 4> heights = {-outer, -inner, inner, outer};
  const std::array<double, 4> weights = {light, heavy, heavy, light};
  constexpr int kAngles = 8;
  std::array<SphereNode, 32> nodes{};
  std::size_t next = 0;
  for (std::size_t n = 0; n < heights.size(); ++n) {
    for (int a = 0; a < kAngles; ++a) {
      const double angle = 2.0 * std::numbers::pi * (a + 0.5) / kAngles;
      const double radius = std::sqrt(1.0 - heights[n] * heights[n]);
      nodes[next++] = {radius * std::cos(angle), radius * std::sin(angle), heights[n],
                       weights[n] * 2.0 * std::numbers::pi / kAngles};
    }
  }
  return nodes;
}

}  // namespace segsim::renderer::internal
