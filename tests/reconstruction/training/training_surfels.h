#pragma once

/// @file
/// Surfel parameters, images and derivatives that own their memory, and scenes of them.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/random.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction::testing {

template <class Real>
struct OwnedSurfels {
  int sh_degree = 0, active_sh_degree = 0;
  std::vector<Real> position_m, log_scale, rotation, opacity_logit, sh;

  [[nodiscard]] std::int64_t count() const {
    return static_cast<std::int64_t>(opacity_logit.size());
  }
  [[nodiscard]] SurfelParameters<Real> view() const {
    return {count(),          sh_degree,       active_sh_degree,     position_m.data(),
            log_scale.data(), rotation.data(), opacity_logit.data(), sh.data()};
  }
};

template <class Real>
struct OwnedGradients {
  std::vector<Real> position_m, log_scale, rotation, opacity_logit, sh, screen;

  explicit OwnedGradients(const OwnedSurfels<Real>& s)
      : position_m(s.position_m.size(), Real(7)),
        log_scale(s.log_scale.size(), Real(7)),
        rotation(s.rotation.size(), Real(7)),
        opacity_logit(s.opacity_logit.size(), Real(7)),
        sh(s.sh.size(), Real(7)),
        screen(s.opacity_logit.size(), Real(7)) {}
  [[nodiscard]] SurfelGradients<Real> view() {
    return {position_m.data(), log_scale.data(), rotation.data(), opacity_logit.data(),
            sh.data(),         screen.data(),    nullptr};
  }
};

template <class Real>
struct OwnedImages {
  int width_px, height_px;
  std::vector<Real> rgb, depth_m, alpha, normal, median_m, distortion;

  explicit OwnedImages(const core::CameraIntrinsics& c)
      : width_px(c.width_px),
        height_px(c.height_px),
        rgb(3 * area(), Real(0)),
        depth_m(area(), Real(0)),
        alpha(area(), Real(0)),
        normal(3 * area(), Real(0)),
        median_m(area(), Real(0)),
        distortion(area(), Real(0)) {}
  [[nodiscard]] std::size_t area() const {
    return static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
  }
  [[nodiscard]] TrainingImages<Real> view() {
    return {width_px,     height_px,     rgb.data(),      depth_m.data(),
            alpha.data(), normal.data(), median_m.data(), distortion.data()};
  }
  [[nodiscard]] TrainingImages<const Real> const_view() const {
    return {width_px,     height_px,     rgb.data(),      depth_m.data(),
            alpha.data(), normal.data(), median_m.data(), distortion.data()};
  }
};

inline double logit(double opacity) { return std::log(opacity / (1.0 - opacity)); }

/// One surfel, as its parameters.
struct RawSurfel {
  glm::dvec3 position_m{0.0, 0.0, 2.0};
  glm::dvec3 normal_axis{0.0, 0.0, 0.0};  ///< Rotation vector [rad] from the image plane.
  double scale_u_m = 0.1, scale_v_m = 0.1;
  double opacity = 0.8;
  double quaternion_length = 1.0;
};

/// Appends; SH coefficients are random, those beyond degree 0 small.
template <class Real>
void add_raw(OwnedSurfels<Real>& surfels, const RawSurfel& raw, core::RandomStream& random) {
  const auto push = [](std::vector<Real>& to, double value) {
    to.push_back(static_cast<Real>(value));
  };
  for (int k = 0; k < 3; ++k) push(surfels.position_m, raw.position_m[k]);
  push(surfels.log_scale, std::log(raw.scale_u_m));
  push(surfels.log_scale, std::log(raw.scale_v_m));
  const double angle = glm::length(raw.normal_axis);
  const glm::dquat q = angle > 0.0 ? glm::angleAxis(angle, raw.normal_axis / angle)
                                   : glm::dquat(1.0, 0.0, 0.0, 0.0);
  for (const double value : {q.w, q.x, q.y, q.z}) {
    push(surfels.rotation, raw.quaternion_length * value);
  }
  push(surfels.opacity_logit, logit(raw.opacity));
  const int coefficients = (surfels.sh_degree + 1) * (surfels.sh_degree + 1);
  for (int k = 0; k < coefficients; ++k) {
    for (int c = 0; c < 3; ++c) push(surfels.sh, (k == 0 ? 1.2 : 0.3) * random.normal());
  }
}

/// Overlapping discs of all kinds before a camera at the origin that looks along +z.
template <class Real>
OwnedSurfels<Real> random_surfels(std::uint64_t seed, int count, int sh_degree) {
  core::RandomStream random(seed, "random_surfels");
  OwnedSurfels<Real> surfels;
  surfels.sh_degree = surfels.active_sh_degree = sh_degree;
  for (int i = 0; i < count; ++i) {
    RawSurfel raw;
    const double z = random.uniform(0.6, 4.0);
    const double x = random.uniform(-0.6, 0.6), y = random.uniform(-0.5, 0.5);
    raw.position_m = z * glm::dvec3(x, y, 1.0);
    raw.normal_axis = {random.normal(), random.normal(), random.normal()};
    raw.scale_u_m = z * std::exp(random.uniform(-5.0, -1.2));
    raw.scale_v_m = raw.scale_u_m * std::exp(random.uniform(-1.5, 0.5));
    raw.opacity = random.uniform(0.05, 0.97);
    raw.quaternion_length = random.uniform(0.5, 2.0);
    add_raw(surfels, raw, random);
  }
  return surfels;
}

/// Discs that reach through the near plane.
template <class Real>
OwnedSurfels<Real> near_plane_surfels() {
  core::RandomStream random(5, "near");
  OwnedSurfels<Real> surfels;
  add_raw(surfels, {{0.05, -0.1, 0.3}, {1.1, 0.3, 0.1}, 0.3, 0.2, 0.7, 1.3}, random);
  add_raw(surfels, {{-0.2, 0.1, 0.4}, {0.4, -1.2, 0.5}, 0.5, 0.3, 0.5, 0.8}, random);
  // The low pass shows the part of its plane that is nearer than the near plane.
  add_raw(surfels, {{0.005, 0.004, 0.07}, {1.45, 0.2, 0.1}, 0.003, 0.04, 0.6, 1.0}, random);
  add_raw(surfels, {{0.0, 0.2, 1.6}, {0.3, 0.2, 0.1}, 0.4, 0.4, 0.9, 1.0}, random);
  return surfels;
}

/// Before a large disc: below a pixel, and slender: the low pass decides about alpha, and the
/// limits of the disc's depth about the depth.
template <class Real>
OwnedSurfels<Real> low_pass_surfels() {
  core::RandomStream random(6, "low pass");
  OwnedSurfels<Real> surfels;
  surfels.sh_degree = surfels.active_sh_degree = 1;
  for (int i = 0; i < 8; ++i) {
    const double z = random.uniform(0.5, 3.0);
    const double x = random.uniform(-0.4, 0.4), y = random.uniform(-0.4, 0.4);
    const double tilt = 0.6 + 0.1 * i;
    add_raw(surfels,
            {z * glm::dvec3(x, y, 1.0),
             {tilt, 0.2 * random.normal(), random.normal()},
             z * (i % 2 == 0 ? 0.15 : 0.004),
             z * 0.003,
             random.uniform(0.3, 0.9),
             random.uniform(0.6, 1.5)},
            random);
  }
  add_raw(surfels, {{0.1, 0.0, 3.5}, {0.3, 0.2, 0.1}, 0.9, 1.1, 0.6, 1.0}, random);
  return surfels;
}

/// Surfels that clamp alpha, and finish pixels before the last one.
template <class Real>
OwnedSurfels<Real> opaque_surfels() {
  core::RandomStream random(7, "clamped");
  OwnedSurfels<Real> surfels;
  add_raw(surfels, {{0.0, 0.0, 1.5}, {0.3, 0.2, 0.1}, 0.3, 0.35, 0.9999, 1.1}, random);
  add_raw(surfels, {{0.1, 0.1, 1.8}, {-0.2, 0.4, 0.3}, 0.4, 0.3, 0.7, 0.9}, random);
  add_raw(surfels, {{-0.1, 0.1, 2.2}, {0.1, 0.4, -0.3}, 0.5, 0.4, 0.9995, 0.9}, random);
  add_raw(surfels, {{0.2, -0.1, 2.5}, {0.1, -0.4, -0.3}, 0.5, 0.6, 0.8, 0.9}, random);
  return surfels;
}

/// Before a large disc: the eye lies almost in the discs' planes, above and below |det J| =
/// kEdgeOn |J|^2.
template <class Real>
OwnedSurfels<Real> edge_on_surfels() {
  core::RandomStream random(8, "edge on");
  OwnedSurfels<Real> surfels;
  const double quarter = 1.5707963267948966;
  add_raw(surfels, {{0.02, 0.001, 1.0}, {quarter, 0.0, 0.0}, 0.2, 0.2, 0.8, 1.0}, random);
  add_raw(surfels, {{0.1, -0.2, 1.2}, {quarter - 0.158, 0.0, 0.0}, 0.1, 0.2, 0.7, 1.2},
          random);
  add_raw(surfels, {{-0.2, 1e-5, 1.1}, {quarter, 0.0, 0.0}, 0.1, 0.15, 0.8, 1.0}, random);
  add_raw(surfels, {{0.1, 0.0, 3.5}, {0.3, 0.2, 0.1}, 0.9, 1.1, 0.6, 1.0}, random);
  return surfels;
}

template <class To, class From>
OwnedSurfels<To> converted(const OwnedSurfels<From>& from) {
  const auto copy = [](const std::vector<From>& values) {
    return std::vector<To>(values.begin(), values.end());
  };
  return {from.sh_degree,       from.active_sh_degree, copy(from.position_m),
          copy(from.log_scale), copy(from.rotation),   copy(from.opacity_logit),
          copy(from.sh)};
}

/// The parameters of a scene; opacities below 1.
template <class Real>
OwnedSurfels<Real> parameters_of(const renderer::SurfelCloud& cloud) {
  OwnedSurfels<Real> surfels;
  surfels.sh_degree = surfels.active_sh_degree = cloud.sh_degree;
  const auto push = [](std::vector<Real>& to, double value) {
    to.push_back(static_cast<Real>(value));
  };
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    for (int k = 0; k < 3; ++k) push(surfels.position_m, cloud.position_m[i][k]);
    for (int k = 0; k < 2; ++k) {
      push(surfels.log_scale, std::log(static_cast<double>(cloud.scale_m[i][k])));
    }
    const glm::quat& q = cloud.R_world_surfel[i];
    for (const float value : {q.w, q.x, q.y, q.z}) push(surfels.rotation, value);
    push(surfels.opacity_logit,
         logit(std::min(static_cast<double>(cloud.opacity[i]), 1.0 - 1e-6)));
  }
  for (const glm::vec3& sh : cloud.sh) {
    for (int k = 0; k < 3; ++k) push(surfels.sh, sh[k]);
  }
  return surfels;
}

/// Random derivatives of a loss by the images, as if of a mean over the pixels.
template <class Real>
OwnedImages<Real> random_loss(std::uint64_t seed, const core::CameraIntrinsics& camera) {
  core::RandomStream random(seed, "random_loss");
  OwnedImages<Real> loss(camera);
  const double scale = 1.0 / static_cast<double>(loss.area());
  for (auto* image : {&loss.rgb, &loss.depth_m, &loss.alpha, &loss.normal, &loss.distortion}) {
    for (Real& value : *image) value = static_cast<Real>(scale * random.normal());
  }
  return loss;
}

}  // namespace segsim::reconstruction::testing
