#include "renderer/scene/sphere_quadrature.h"

#include <cmath>

#include <gtest/gtest.h>

namespace segsim::renderer::internal {
namespace {

/// Integral of x^a y^b z^c over the unit sphere: 0 if an exponent is odd, else
/// 2 G((a+1)/2) G((b+1)/2) G((c+1)/2) / G((a+b+c+3)/2), G the gamma function (Folland 2001).
double monomial_integral(int a, int b, int c) {
  if (a % 2 != 0 || b % 2 != 0 || c % 2 != 0) return 0.0;
  const auto g = [](int twice) { return std::tgamma(0.5 * twice); };
  return 2.0 * g(a + 1) * g(b + 1) * g(c + 1) / g(a + b + c + 3);
}

TEST(SphereQuadrature, IsExactUpToDegreeSeven) {
  for (int a = 0; a <= 7; ++a) {
    for (int b = 0; a + b <= 7; ++b) {
      for (int c = 0; a + b + c <= 7; ++c) {
        double sum = 0.0;
        for (const SphereNode& node : sphere_quadrature()) {
          sum += node.weight * std::pow(node.x, a) * std::pow(node.y, b) * std::pow(node.z, c);
        }
        EXPECT_NEAR(sum, monomial_integral(a, b, c), 1e-14) << a << ' ' << b << ' ' << c;
      }
    }
  }
}

}  // namespace
}  // namespace segsim::renderer::internal
