// 10^5 random surfels of every awkward kind: the box on the screen against its rim, searched
// numerically.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "core/random.h"
#include "renderer/scene/surfel_geometry.h"
#include "tests/renderer/awkward_surfels.h"

namespace segsim::renderer {
namespace {

using core::RandomStream;
/// Surfels whose centre lies behind the camera have no outline.
constexpr int kKinds = testing::kBehind;

constexpr double kNearM = 0.05;
constexpr int kCases = 100000;

/// A camera at the origin that looks along +z.
template <class Real>
ProjectionCamera<Real> camera() {
  return {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}, 520, 480, 323, 236};
}

/// As floats, so that both precisions see the same surfel.
struct Disc {
  Vec3<float> centre_m, u_m, v_m;
  float opacity;
};

Vec3<float> vec(const glm::dvec3& v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}
template <class Real>
Vec3<Real> cast(const Vec3<float>& v) {
  return {static_cast<Real>(v.x), static_cast<Real>(v.y), static_cast<Real>(v.z)};
}
template <class Real>
SurfelProjection<Real> project(const Disc& d) {
  return project_surfel<Real>(camera<Real>(), cast<Real>(d.centre_m), cast<Real>(d.u_m),
                              cast<Real>(d.v_m));
}

Disc random_disc(RandomStream& random, testing::AwkwardKind kind) {
  const testing::AwkwardDisc d = testing::random_awkward_disc(random, kind);
  return {vec(d.centre_m), vec(d.scale_u_m * d.u), vec(d.scale_v_m * d.v),
          static_cast<float>(d.opacity)};
}

/// The part of a disc's rim that lies beyond the near plane; angles in radians. Along the rim
/// z = z0 + reach cos(angle - highest), so the part is one arc.
class Rim {
 public:
  Rim(const Disc& d, double k2)
      : centre_(wide(d.centre_m)),
        u_(std::sqrt(k2) * wide(d.u_m)),
        v_(std::sqrt(k2) * wide(d.v_m)),
        highest_(std::atan2(v_.z, u_.z)) {
    const double cosine = (kNearM - centre_.z) / std::hypot(u_.z, v_.z);
    half_arc_ = cosine <= -1.0 ? std::numbers::pi : std::acos(std::min(cosine, 1.0));
  }

  /// @param t  -1 ... 1 along the arc, slower towards its ends, where images are stretched.
  [[nodiscard]] glm::dvec3 at(double t) const {
    const double angle = highest_ + half_arc_ * std::sin(0.5 * std::numbers::pi * t);
    return centre_ + std::cos(angle) * u_ + std::sin(angle) * v_;
  }

  /// Largest value of f: the best of many samples, then thirds of the interval about it.
  template <class F>
  [[nodiscard]] double maximum(const F& f) const {
    constexpr int kSteps = 128;
    int best = 0;
    for (int i = 0; i <= kSteps; ++i) {
      if (f(at(2.0 * i / kSteps - 1.0)) > f(at(2.0 * best / kSteps - 1.0))) best = i;
    }
    double lo = 2.0 * std::max(best - 1, 0) / kSteps - 1.0;
    double hi = 2.0 * std::min(best + 1, kSteps) / kSteps - 1.0;
    for (int i = 0; i < 50; ++i) {
      const double third = (hi - lo) / 3.0;
      if (f(at(lo + third)) < f(at(hi - third))) {
        lo += third;
      } else {
        hi -= third;
      }
    }
    return std::max(f(at(0.5 * (lo + hi))), f(at(2.0 * best / kSteps - 1.0)));
  }

  [[nodiscard]] ScreenBox<double> box() const {
    const auto c = camera<double>();
    const auto x = [&](const glm::dvec3& p) { return c.fx_px * p.x / p.z + c.cx_px; };
    const auto y = [&](const glm::dvec3& p) { return c.fy_px * p.y / p.z + c.cy_px; };
    return {-maximum([&](const glm::dvec3& p) { return -x(p); }), maximum(x),
            -maximum([&](const glm::dvec3& p) { return -y(p); }), maximum(y)};
  }

 private:
  static glm::dvec3 wide(const Vec3<float>& v) { return {v.x, v.y, v.z}; }
  glm::dvec3 centre_, u_, v_;
  double highest_, half_arc_;
};

double largest_difference(const ScreenBox<double>& a, const ScreenBox<double>& b) {
  return std::max({std::abs(a.x_min_px - b.x_min_px), std::abs(a.x_max_px - b.x_max_px),
                   std::abs(a.y_min_px - b.y_min_px), std::abs(a.y_max_px - b.y_max_px)});
}
double size_of(const ScreenBox<double>& a) {
  return std::max(a.x_max_px - a.x_min_px, a.y_max_px - a.y_min_px);
}
ScreenBox<double> wide(const ScreenBox<float>& b) {
  return {b.x_min_px, b.x_max_px, b.y_min_px, b.y_max_px};
}
bool inside_image_range(const ScreenBox<double>& b) {
  return b.x_min_px > -640 && b.x_max_px < 1280 && b.y_min_px > -480 && b.y_max_px < 960;
}

TEST(SurfelOutline, HundredThousandSurfelsHaveTheBoxOfTheirRim) {
  RandomStream random(1, "outline_property");
  std::array<int, kKinds> whole{}, clipped{};
  int invisible = 0, floats = 0;
  double worst_whole = 0.0, worst_clipped = 0.0, worst_float_px = 0.0;
  for (int i = 0; i < kCases; ++i) {
    const auto kind = static_cast<testing::AwkwardKind>(i % kKinds);
    const Disc disc = random_disc(random, kind);
    const double k2 = extent_squared(static_cast<double>(disc.opacity));
    if (k2 <= 0.0 || disc.centre_m.z <= kNearM) {
      ++invisible;
      continue;
    }
    const auto s = project<double>(disc);
    const ScreenBox<double> rim = Rim(disc, k2).box();
    if (crosses_near_plane(s, k2, kNearM)) {
      ++clipped[kind];
      const ScreenBox<double> box = box_of_clipped_disc(s, k2, kNearM);
      // The cut of the near plane ends on the rim, so the rim has all extremes.
      const double off = largest_difference(box, rim) / size_of(rim);
      worst_clipped = std::max(worst_clipped, off);
      ASSERT_LT(off, 1e-5) << "clipped, case " << i << " kind " << kind;
      continue;
    }
    ++whole[kind];
    const ScreenBox<double> box = box_of(outline_of_disc(s, k2));
    const double off = largest_difference(box, rim) / std::max(size_of(rim), 1e-9);
    worst_whole = std::max(worst_whole, off);
    ASSERT_LT(off, 1e-5) << "case " << i << " kind " << kind;
    if (!inside_image_range(box)) continue;
    ++floats;
    const auto rounded = project<float>(disc);
    const auto box_float = wide(box_of(outline_of_disc(rounded, static_cast<float>(k2))));
    worst_float_px = std::max(worst_float_px, largest_difference(box, box_float));
  }
  for (int kind = 0; kind < kKinds; ++kind) {
    EXPECT_GT(whole[kind] + clipped[kind], 2000) << "kind " << kind;
  }
  EXPECT_GT(clipped[testing::kAroundTheCamera] + clipped[testing::kHuge], 10000);
  EXPECT_GT(invisible, 3000);
  EXPECT_GT(floats, 30000);
  EXPECT_LT(worst_float_px, 1e-3);
  RecordProperty("worst_whole_1e-9", std::to_string(1e9 * worst_whole));
  RecordProperty("worst_clipped_1e-9", std::to_string(1e9 * worst_clipped));
  RecordProperty("worst_float_px", std::to_string(worst_float_px));
}

}  // namespace
}  // namespace segsim::renderer
