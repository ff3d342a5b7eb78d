#pragma once

/// @file
/// Light that arrives at one point of a scene: lamps with soft shadows and one bounce, by ray
/// casting. All random numbers come from the caller's stream.

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "core/random.h"
#include "sim/ground/mesh_scene.h"
#include "sim/ground/ray_scene.h"
#include "worlds/capture/irradiance_cache.h"
#include "worlds/capture/surface_shading.h"

namespace segsim::worlds::internal {

inline constexpr float kPi = std::numbers::pi_v<float>;
/// Softens the inverse square law near a lamp, see PointLight [m^2].
inline constexpr float kLampSoftening_m2 = 0.15F;
/// Lamps that could give less than this share of a point's light are left out.
inline constexpr float kNegligibleShare = 0.005F;
/// What bounces after the first one add, as a factor on the first: 1 / (1 - 0.3), where 0.3 is
/// the mean reflectance of a furnished room.
inline constexpr float kLaterBounces = 1.4F;
/// A shadow ray ends this far from the lamp: the lamp's own housing must not block it [m].
inline constexpr float kHousing_m = 0.12F;
/// Bounce light is averaged over patches of this size, which keeps texture noise out [m].
inline constexpr float kBouncePatch_m = 0.2F;
inline constexpr float kMaxBounceRadiance = 4.0F;
/// Points are lifted off their surface, which they would otherwise hit [m].
inline constexpr float kSurfaceOffset_m = 1e-3F;

inline float luminance(const glm::vec3& c) {
  return 0.2126F * c.x + 0.7152F * c.y + 0.0722F * c.z;
}

inline float uniform(core::RandomStream& random) {
  return static_cast<float>(random.next_u32() >> 8U) * 0x1p-24F;
}

/// Two unit vectors that span the plane across `n`.
inline void tangents(const glm::vec3& n, glm::vec3& a, glm::vec3& b) {
  const glm::vec3 hint = std::abs(n.x) > 0.5F ? glm::vec3(0, 1, 0) : glm::vec3(1, 0, 0);
  a = glm::normalize(glm::cross(hint, n));
  b = glm::cross(n, a);
}

/// Evenly in the unit ball.
inline glm::vec3 in_ball(core::RandomStream& random) {
  const float z = 2.0F * uniform(random) - 1.0F;
  const float azimuth = 2.0F * kPi * uniform(random);
  const float radius = std::cbrt(uniform(random));
  const float ring = std::sqrt(std::max(0.0F, 1.0F - z * z));
  return radius * glm::vec3(ring * std::cos(azimuth), ring * std::sin(azimuth), z);
}

/// Light that was gathered at one point.
struct Gathered {
  glm::vec3 irradiance{0.0F};
  glm::vec3 flow{0.0F};  ///< Luminance-weighted sum of directions to the light.

  /// @param part  Share of the irradiance, cosine included. @param cosine  Of the direction.
  void add(const glm::vec3& part, const glm::vec3& direction, float cosine) {
    irradiance += part;
    flow += direction * (luminance(part) / std::max(cosine, 0.1F));
  }
};

class Gatherer {
 public:
  Gatherer(const sim::RayScene& rays, const SurfaceShading& surfaces,
           const std::vector<sim::PointLight>& lights, const IrradianceOptions& options)
      : rays_(rays), surfaces_(surfaces), lights_(lights), options_(options) {}

  [[nodiscard]] Gathered gather(const glm::vec3& point_m, const glm::vec3& normal,
                                core::RandomStream& random) const {
    Gathered light;
    add_lamps(point_m, normal, random, light);
    add_bounce(point_m, normal, random, light);
    return light;
  }

 private:
  /// Unshadowed irradiance from one lamp.
  static glm::vec3 unshadowed(const sim::PointLight& lamp, const glm::vec3& point_m,
                              const glm::vec3& normal) {
    const glm::vec3 offset = lamp.position_m - point_m;
    const float distance2 = glm::dot(offset, offset);
    const float cosine = glm::dot(normal, offset) / std::sqrt(std::max(distance2, 1e-6F));
    if (cosine <= 0.0F) return glm::vec3(0.0F);
    return lamp.radiance * (cosine / (distance2 + kLampSoftening_m2));
  }

  [[nodiscard]] bool sees(const glm::vec3& point_m, const sim::PointLight& lamp,
                          core::RandomStream& random) const {
    const glm::vec3 target = lamp.position_m + lamp.radius_m * in_ball(random);
    const glm::vec3 offset = target - point_m;
    const float distance = glm::length(offset);
    if (distance <= kHousing_m) return true;
    return !rays_.occluded(point_m, offset / distance, 0.0F, distance - kHousing_m);
  }

  void add_lamps(const glm::vec3& point_m, const glm::vec3& normal, core::RandomStream& random,
                 Gathered& light) const {
    float total = 0.0F;
    for (const sim::PointLight& lamp : lights_)
      total += luminance(unshadowed(lamp, point_m, normal));
    for (const sim::PointLight& lamp : lights_) {
      const glm::vec3 full = unshadowed(lamp, point_m, normal);
      const float share = luminance(full) / total;
      if (!(share > kNegligibleShare)) continue;
      const int samples =
          std::clamp(static_cast<int>(std::ceil(4.0F * share *
                                                static_cast<float>(options_.shadow_samples))),
                     1, options_.shadow_samples);
      int seen = 0;
      for (int i = 0; i < samples; ++i) seen += sees(point_m, lamp, random) ? 1 : 0;
      const glm::vec3 direction = glm::normalize(lamp.position_m - point_m);
      light.add(full * (static_cast<float>(seen) / static_cast<float>(samples)), direction,
                glm::dot(normal, direction));
    }
  }

  /// Irradiance from all lamps, estimated with one shadow ray to one lamp, which is drawn in
  /// proportion to what it would give (reservoir sampling: one pass over the lamps).
  [[nodiscard]] glm::vec3 one_lamp(const glm::vec3& point_m, const glm::vec3& normal,
                                   core::RandomStream& random) const {
    float left = uniform(random);
    float total = 0.0F;
    const sim::PointLight* chosen = nullptr;
    glm::vec3 full(0.0F);
    for (const sim::PointLight& lamp : lights_) {
      const glm::vec3 candidate = unshadowed(lamp, point_m, normal);
      const float weight = luminance(candidate);
      if (!(weight > 0.0F)) continue;
      total += weight;
      // One number serves all draws: what a draw leaves over is uniform again.
      const float share = weight / total;
      if (left < share) {
        chosen = &lamp;
        full = candidate;
        left /= share;
      } else {
        left = (left - share) / (1.0F - share);
      }
    }
    if (chosen == nullptr || !sees(point_m, *chosen, random)) return glm::vec3(0.0F);
    return full * (total / luminance(full));
  }

  void add_bounce(const glm::vec3& point_m, const glm::vec3& normal,
                  core::RandomStream& random, Gathered& light) const {
    const int side =
        std::max(1, static_cast<int>(
                        std::lround(std::sqrt(static_cast<double>(options_.bounce_samples)))));
    const auto strata = static_cast<float>(side);
    glm::vec3 a;
    glm::vec3 b;
    tangents(normal, a, b);
    for (int row = 0; row < side; ++row) {
      for (int column = 0; column < side; ++column) {
        // Cosine-weighted, one direction per stratum.
        const float azimuth =
            2.0F * kPi * (static_cast<float>(column) + uniform(random)) / strata;
        const float sine2 = (static_cast<float>(row) + uniform(random)) / strata;
        const float cosine = std::sqrt(std::max(0.0F, 1.0F - sine2));
        const float sine = std::sqrt(sine2);
        const glm::vec3 direction =
            sine * (std::cos(azimuth) * a + std::sin(azimuth) * b) + cosine * normal;
        const sim::RayHit hit = rays_.cast(point_m, direction);
        if (!hit.hit()) continue;
        const glm::vec3 facing =
            glm::dot(hit.normal, direction) > 0.0F ? -hit.normal : hit.normal;
        const glm::vec3 there = point_m + hit.t * direction + kSurfaceOffset_m * facing;
        const glm::vec3 emitted =
            glm::min(surfaces_.emission(hit), glm::vec3(kMaxBounceRadiance));
        const glm::vec3 part = kLaterBounces * surfaces_.albedo(hit, kBouncePatch_m) *
                                   one_lamp(there, facing, random) +
                               kPi * emitted;
        light.add(part / (strata * strata), direction, cosine);
      }
    }
  }

  const sim::RayScene& rays_;
  const SurfaceShading& surfaces_;
  const std::vector<sim::PointLight>& lights_;
  const IrradianceOptions& options_;
};

}  // namespace segsim::worlds::internal
