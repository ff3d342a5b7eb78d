#include "renderer/scene/surfel_geometry.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

#include "core/random.h"

namespace segsim::renderer {
namespace {

using core::RandomStream;

Vec3<double> vec(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

template <class Real>
Vec3<Real> cast(const Vec3<double>& v) {
  return {static_cast<Real>(v.x), static_cast<Real>(v.y), static_cast<Real>(v.z)};
}

/// A camera at the origin that looks along +z, so that world and camera frames agree.
template <class Real>
ProjectionCamera<Real> camera() {
  return {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}, 520, 480, 323, 236};
}

struct Disc {
  glm::dvec3 centre_m, u_m, v_m;  ///< u, v: tangents times scales.
  double k2;

  [[nodiscard]] glm::dvec3 at(const glm::dvec2& uv) const {
    return centre_m + uv.x * u_m + uv.y * v_m;
  }
  template <class Real>
  [[nodiscard]] SurfelProjection<Real> projected() const {
    return project_surfel<Real>(camera<Real>(), cast<Real>(vec(centre_m)),
                                cast<Real>(vec(u_m)), cast<Real>(vec(v_m)));
  }
};

glm::dvec2 pixel_of(const glm::dvec3& p) {
  const auto c = camera<double>();
  return {c.fx_px * p.x / p.z + c.cx_px, c.fy_px * p.y / p.z + c.cy_px};
}

Disc random_disc(RandomStream& random, double scale_max_m) {
  const auto normal3 = [&] {
    const double x = random.normal(), y = random.normal(), z = random.normal();
    return glm::dvec3(x, y, z);
  };
  const glm::dvec3 n = glm::normalize(normal3());
  const glm::dvec3 u = glm::normalize(glm::cross(n, normal3()));
  const glm::dvec3 v = glm::cross(n, u);
  const double z = random.uniform(0.3, 6.0);
  const double x = random.uniform(-0.6, 0.6), y = random.uniform(-0.5, 0.5);
  const double su = random.uniform(0.002, scale_max_m),
               sv = random.uniform(0.002, scale_max_m);
  return {{x * z, y * z, z}, su * u, sv * v, extent_squared(random.uniform(0.05, 1.0))};
}

/// A point of the disc's rim.
glm::dvec2 rim(const Disc& disc, double angle_rad) {
  return std::sqrt(disc.k2) * glm::dvec2(std::cos(angle_rad), std::sin(angle_rad));
}

constexpr double kNearM = 0.05;

TEST(Outline, PassesThroughTheProjectedRim) {
  RandomStream random(1, "outline");
  int checked = 0;
  for (int i = 0; i < 2000; ++i) {
    const Disc disc = random_disc(random, 0.2);
    const auto s = disc.projected<double>();
    if (s.edge_on || crosses_near_plane(s, disc.k2, kNearM)) continue;
    ++checked;
    const ScreenEllipse<double> e = outline_of_disc(s, disc.k2);
    const double det = e.sxx * e.syy - e.sxy * e.sxy;
    for (int step = 0; step < 64; ++step) {
      const glm::dvec2 p = pixel_of(disc.at(rim(disc, step * std::numbers::pi / 32.0)));
      const double x = p.x - e.cx_px, y = p.y - e.cy_px;
      const double value = (e.syy * x * x - 2.0 * e.sxy * x * y + e.sxx * y * y) / det;
      // The determinant cancels as the ellipse gets thin: edge-on is at 1e-4.
      ASSERT_NEAR(value, 1.0, 1e-6) << "disc " << i;
    }
  }
  EXPECT_GT(checked, 1000);
}

TEST(Outline, BoxIsThatOfTheRim) {
  RandomStream random(2, "outline");
  for (int i = 0; i < 300; ++i) {
    const Disc disc = random_disc(random, 0.2);
    const auto s = disc.projected<double>();
    if (crosses_near_plane(s, disc.k2, kNearM)) continue;
    const ScreenBox<double> box = box_of(outline_of_disc(s, disc.k2));
    glm::dvec2 lo(1e30), hi(-1e30);
    for (int step = 0; step < 4000; ++step) {
      const glm::dvec2 p = pixel_of(disc.at(rim(disc, step * std::numbers::pi / 2000.0)));
      lo = glm::min(lo, p);
      hi = glm::max(hi, p);
    }
    const double tolerance_px = 1e-4 * (hi.x - lo.x + hi.y - lo.y) + 1e-9;
    EXPECT_NEAR(box.x_min_px, lo.x, tolerance_px);
    EXPECT_NEAR(box.x_max_px, hi.x, tolerance_px);
    EXPECT_NEAR(box.y_min_px, lo.y, tolerance_px);
    EXPECT_NEAR(box.y_max_px, hi.y, tolerance_px);
  }
}

TEST(Outline, FloatAgreesWithDouble) {
  RandomStream random(3, "outline");
  double worst_px = 0.0;
  for (int i = 0; i < 20000; ++i) {
    const Disc disc = random_disc(random, 0.05);
    const auto s = disc.projected<double>();
    if (crosses_near_plane(s, disc.k2, 0.2)) continue;
    const auto exact = box_of(outline_of_disc(s, disc.k2));
    const auto rounded =
        box_of(outline_of_disc(disc.projected<float>(), static_cast<float>(disc.k2)));
    // Beyond the image nobody looks.
    if (exact.x_max_px - exact.x_min_px > 640 || exact.y_max_px - exact.y_min_px > 480)
      continue;
    worst_px =
        std::max({worst_px, std::abs(exact.x_min_px - static_cast<double>(rounded.x_min_px)),
                  std::abs(exact.x_max_px - static_cast<double>(rounded.x_max_px)),
                  std::abs(exact.y_min_px - static_cast<double>(rounded.y_min_px)),
                  std::abs(exact.y_max_px - static_cast<double>(rounded.y_max_px))});
  }
  EXPECT_LT(worst_px, 1e-3);
}

TEST(NearPlane, BoxHoldsTheVisiblePartTightly) {
  RandomStream random(4, "near");
  int crossing = 0;
  for (int i = 0; i < 4000 && crossing < 400; ++i) {
    Disc disc = random_disc(random, 0.4);
    disc.centre_m *= random.uniform(0.2, 1.0);
    if (disc.centre_m.z <= 1.05 * kNearM) continue;
    const auto s = disc.projected<double>();
    if (!crosses_near_plane(s, disc.k2, kNearM)) continue;
    ++crossing;
    const ScreenBox<double> box = box_of_clipped_disc(s, disc.k2, kNearM);
    glm::dvec2 lo(1e30), hi(-1e30);
    const auto include = [&](const glm::dvec3& p) {
      lo = glm::min(lo, pixel_of(p));
      hi = glm::max(hi, pixel_of(p));
    };
    // The visible part is convex: its extremes lie on the rim or where the rim meets the
    // plane.
    constexpr double kStep = std::numbers::pi / 2000.0;
    for (int step = 0; step < 4000; ++step) {
      double visible = step * kStep, hidden = (step + 1) * kStep;
      const auto z = [&](double angle_rad) { return disc.at(rim(disc, angle_rad)).z; };
      if (z(visible) >= kNearM) include(disc.at(rim(disc, visible)));
      if ((z(visible) >= kNearM) == (z(hidden) >= kNearM)) continue;
      if (z(visible) < kNearM) std::swap(visible, hidden);
      for (int halving = 0; halving < 50; ++halving) {
        const double middle = 0.5 * (visible + hidden);
        (z(middle) >= kNearM ? visible : hidden) = middle;
      }
      include(disc.at(rim(disc, visible)));
    }
    const double slack_px = 1e-6 * (hi.x - lo.x + hi.y - lo.y);
    EXPECT_LE(box.x_min_px, lo.x + slack_px);
    EXPECT_GE(box.x_max_px, hi.x - slack_px);
    EXPECT_LE(box.y_min_px, lo.y + slack_px);
    EXPECT_GE(box.y_max_px, hi.y - slack_px);
    EXPECT_NEAR(box.x_max_px - box.x_min_px, hi.x - lo.x, 1e-3 * (hi.x - lo.x));
    EXPECT_NEAR(box.y_max_px - box.y_min_px, hi.y - lo.y, 1e-3 * (hi.y - lo.y));
  }
  EXPECT_EQ(crossing, 400);
}

/// rho of the local form at an image position, infinite behind the camera.
double rho_at(const SurfelProjection<double>& s, const glm::dvec2& px) {
  const double x = px.x - s.x0_px, y = px.y - s.y0_px;
  const double e = 1.0 - s.g0 * x - s.g1 * y;
  const double u = s.m00 * x + s.m01 * y, v = s.m10 * x + s.m11 * y;
  const double disc = e > 0.0 ? (u * u + v * v) / (e * e) : INFINITY;
  return std::min(disc, 2.0 * (x * x + y * y));
}

TEST(LocalForm, InvertsTheProjection) {
  RandomStream random(5, "local");
  for (int i = 0; i < 2000; ++i) {
    const Disc disc = random_disc(random, 0.2);
    const auto s = disc.projected<double>();
    if (s.edge_on) continue;
    const double u0 = random.normal(), v0 = random.normal();
    const glm::dvec3 p = disc.at({u0, v0});
    if (p.z < kNearM) continue;
    const glm::dvec2 px = pixel_of(p);
    const double x = px.x - s.x0_px, y = px.y - s.y0_px;
    const double e = 1.0 - s.g0 * x - s.g1 * y;
    EXPECT_NEAR((s.m00 * x + s.m01 * y) / e, u0, 1e-6);
    EXPECT_NEAR((s.m10 * x + s.m11 * y) / e, v0, 1e-6);
    EXPECT_NEAR(s.z0_m / e, p.z, 1e-8 * p.z);
  }
}

/// Leftmost and rightmost point with rho <= k^2 on the lines of a band, found by scanning.
std::optional<ColumnSpan<double>> scanned_span(const SurfelProjection<double>& s, double k2,
                                               const ScreenBox<double>& box, double y_lo_px,
                                               double y_hi_px) {
  std::optional<ColumnSpan<double>> span;
  const double step = std::max(0.02, (box.x_max_px - box.x_min_px) / 600.0);
  for (double y = y_lo_px; y <= y_hi_px; y += 0.25) {
    for (double x = box.x_min_px; x <= box.x_max_px; x += step) {
      if (rho_at(s, {x, y}) > k2) continue;
      if (!span) span = {x, x};
      span->x_min_px = std::min(span->x_min_px, x);
      span->x_max_px = std::max(span->x_max_px, x);
    }
  }
  return span;
}

TEST(TileRows, SpanHoldsEveryHitTightly) {
  RandomStream random(6, "rows");
  int bands = 0;
  for (int i = 0; i < 150; ++i) {
    const Disc disc = random_disc(random, 0.06);
    const auto s = disc.projected<double>();
    if (s.edge_on || crosses_near_plane(s, disc.k2, 0.2)) continue;
    const ScreenEllipse<double> outline = outline_of_disc(s, disc.k2);
    const ScreenBox<double> box = with_low_pass(box_of(outline), s, disc.k2);
    const double r = low_pass_radius_px(disc.k2);
    const double step = std::max(0.02, (box.x_max_px - box.x_min_px) / 600.0);
    for (double y_lo = std::floor(box.y_min_px / 16.0) * 16.0 + 0.5; y_lo < box.y_max_px;
         y_lo += 16.0) {
      const ColumnSpan<double> span =
          columns_in_band(outline, s.x0_px, s.y0_px, r * r, y_lo, y_lo + 15.0);
      const auto scanned = scanned_span(s, disc.k2, box, y_lo, y_lo + 15.0);
      if (!scanned) continue;
      ++bands;
      EXPECT_LE(span.x_min_px, scanned->x_min_px + 1e-6);
      EXPECT_GE(span.x_max_px, scanned->x_max_px - 1e-6);
      // The scan steps over slender tips: up to a quarter row times the slope.
      const double tolerance_px = 2.0 * step +
                                  0.6 * (1.0 + std::abs(outline.sxy) / outline.syy) +
                                  0.15 * (box.x_max_px - box.x_min_px);
      EXPECT_NEAR(span.x_min_px, scanned->x_min_px, tolerance_px);
      EXPECT_NEAR(span.x_max_px, scanned->x_max_px, tolerance_px);
    }
  }
  EXPECT_GT(bands, 200);
}

TEST(TileRows, EmptyBandGivesEmptySpan) {
  const ScreenEllipse<double> outline{100.0, 100.0, 25.0, 0.0, 25.0};
  const ColumnSpan<double> span = columns_in_band(outline, 100.0, 100.0, 4.0, 112.5, 127.5);
  EXPECT_GT(span.x_min_px, span.x_max_px);
}

TEST(LowPass, IsSkippedOnlyWhereItChangesNothing) {
  RandomStream random(7, "low_pass");
  int plain = 0, thin = 0;
  for (int i = 0; i < 3000; ++i) {
    const Disc disc = random_disc(random, 0.02);
    const auto s = disc.projected<double>();
    if (s.edge_on || crosses_near_plane(s, disc.k2, 0.2)) continue;
    if (low_pass_matters(s, disc.k2)) {
      ++thin;
      continue;
    }
    ++plain;
    for (int step = 0; step < 200; ++step) {
      const double angle_rad = step * std::numbers::pi / 100.0;
      for (const double radius : {0.1, 0.5, 1.0, 1.7, 2.3}) {
        const double x = radius * std::cos(angle_rad), y = radius * std::sin(angle_rad);
        if (2.0 * radius * radius > disc.k2) continue;
        const double e = 1.0 - s.g0 * x - s.g1 * y;
        const double u = s.m00 * x + s.m01 * y, v = s.m10 * x + s.m11 * y;
        ASSERT_LE((u * u + v * v) / (e * e), 2.0 * radius * radius + 1e-9);
      }
    }
  }
  EXPECT_GT(plain, 300);
  EXPECT_GT(thin, 300);
}

TEST(EdgeOn, IsDrawnByTheLowPassOnly) {
  const Disc disc{{0.0, 0.0, 2.0}, {0.1, 0.0, 0.0}, {0.0, 0.0, 0.1}, extent_squared(0.9)};
  const auto s = disc.projected<float>();
  EXPECT_TRUE(s.edge_on);
  const float one_px = s.m00 * 1.0F;
  EXPECT_GT(one_px * one_px, 100.0F);
  const auto box = box_of(outline_of_disc(s, static_cast<float>(disc.k2)));
  EXPECT_TRUE(std::isfinite(box.x_max_px));
  EXPECT_NEAR(box.y_max_px, box.y_min_px, 1e-3F);
}

TEST(Extent, VanishesAtTheFaintestVisibleOpacity) {
  EXPECT_NEAR(extent_squared(1.0), 11.0825, 1e-4);
  EXPECT_NEAR(extent_squared(1.0 / 255.0), 0.0, 1e-12);
  EXPECT_LT(extent_squared(0.001), 0.0);
}

TEST(SphericalHarmonics, AreOrthonormal) {
  // Midpoint rule in (cos theta, phi): products of degree 6 are integrated to 1e-4.
  constexpr int kSteps = 200;
  double sums[16][16] = {};
  for (int i = 0; i < kSteps; ++i) {
    const double z = -1.0 + (i + 0.5) * 2.0 / kSteps;
    const double r = std::sqrt(1.0 - z * z);
    for (int j = 0; j < kSteps; ++j) {
      const double phi = (j + 0.5) * 2.0 * std::numbers::pi / kSteps;
      double basis[16];
      sh_basis<double>(3, {r * std::cos(phi), r * std::sin(phi), z}, basis);
      const double area = 4.0 * std::numbers::pi / (kSteps * kSteps);
      for (int a = 0; a < 16; ++a) {
        for (int b = 0; b < 16; ++b) sums[a][b] += area * basis[a] * basis[b];
      }
    }
  }
  for (int a = 0; a < 16; ++a) {
    for (int b = 0; b < 16; ++b)
      EXPECT_NEAR(sums[a][b], a == b ? 1.0 : 0.0, 1e-3) << a << " " << b;
  }
}

TEST(SphericalHarmonics, SignsFollowTheFiles) {
  double basis[16];
  sh_basis<double>(3, {0.0, 1.0, 0.0}, basis);
  EXPECT_LT(basis[1], 0.0);
  sh_basis<double>(3, {0.0, 0.0, 1.0}, basis);
  EXPECT_GT(basis[2], 0.0);
  EXPECT_GT(basis[6], 0.0);
  EXPECT_GT(basis[12], 0.0);
  sh_basis<double>(3, {1.0, 0.0, 0.0}, basis);
  EXPECT_LT(basis[3], 0.0);
  EXPECT_GT(basis[8], 0.0);
  EXPECT_LT(basis[15], 0.0);
}

}  // namespace
}  // namespace segsim::renderer
