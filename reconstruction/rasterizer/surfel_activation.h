#pragma once

/// @file
/// Once per surfel and view: from raw parameters (surfel_parameters.h) to what pixels read
/// (DrawnSurfel), and from the sum of the pixels' derivatives (LocalGradient) back to the
/// parameters. Compiled by the host and by a GPU, in float and in double.
///
/// The way back, in the camera's frame, with U = s_u R_c t_u, V = s_v R_c t_v, D. = dL/d. :
///
///     g = M^T w         D_w += M D_g,  D_M += w D_g^T
///     M = J^-1          D_J = -M^T D_M M^T
///     reach = k |w|     D_w += D_reach k w / |w|,  D_k2 = D_reach |w| / (2 k)
///     a = fx (U.x / z0 - X / z0 w.u, ...), w = (U.z, V.z) / z0, x0 = fx X / z0 + cx
///
/// then u = s t by scale and rotation, and the quaternion through its normalisation.

#include <cmath>
#include <cstdint>

#include "core/host_device.h"
#include "reconstruction/rasterizer/sh_adjoint.h"
#include "reconstruction/rasterizer/surfel_adjoint.h"
#include "reconstruction/rasterizer/surfel_parameters.h"

namespace segsim::reconstruction {

/// A surfel in the terms of surfel_geometry.h.
template <class Real>
struct ActiveSurfel {
  renderer::Vec3<Real> position_m;
  renderer::Vec3<Real> t_u, t_v,
      normal;  ///< Unit, world frame; the normal as the quaternion gives it.
  Real scale_u_m, scale_v_m;
  Real opacity;
  Real w, x, y, z;      ///< Unit quaternion.
  Real inverse_length;  ///< 1 / length of the raw quaternion.
};

template <class Real>
SEGSIM_HD inline renderer::Vec3<Real> load_vec3(const Real* values, std::int64_t i) {
  return {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
}

template <class Real>
SEGSIM_HD inline renderer::Vec3<Real> scaled(const renderer::Vec3<Real>& v, Real s) {
  return {v.x * s, v.y * s, v.z * s};
}

template <class Real>
SEGSIM_HD inline Real active_opacity(Real logit) {
  return Real(1) / (Real(1) + std::exp(-logit));
}

template <class Real>
SEGSIM_HD inline ActiveSurfel<Real> activate(const SurfelParameters<Real>& surfels,
                                             std::int64_t i) {
  ActiveSurfel<Real> s;
  s.position_m = load_vec3(surfels.position_m, i);
  const Real* r = surfels.rotation + 4 * i;
  s.inverse_length =
      Real(1) / std::sqrt((r[0] * r[0] + r[1] * r[1]) + (r[2] * r[2] + r[3] * r[3]));
  const Real w = r[0] * s.inverse_length, x = r[1] * s.inverse_length;
  const Real y = r[2] * s.inverse_length, z = r[3] * s.inverse_length;
  s.w = w, s.x = x, s.y = y, s.z = z;
  const Real one = Real(1), two = Real(2);
  s.t_u = {one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)};
  s.t_v = {two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)};
  s.normal = {two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y)};
  s.scale_u_m = std::exp(surfels.log_scale[2 * i]);
  s.scale_v_m = std::exp(surfels.log_scale[2 * i + 1]);
  s.opacity = active_opacity(surfels.opacity_logit[i]);
  return s;
}

/// From the eye to the surfel's centre.
template <class Real>
SEGSIM_HD inline renderer::Vec3<Real> offset_of(const renderer::ProjectionCamera<Real>& camera,
                                                const renderer::Vec3<Real>& position_m) {
  return {position_m.x - camera.centre_m.x, position_m.y - camera.centre_m.y,
          position_m.z - camera.centre_m.z};
}

/// Does the normal as stored point away from the camera? The drawn one is then its opposite.
template <class Real>
SEGSIM_HD inline bool faces_away(const ActiveSurfel<Real>& s,
                                 const renderer::ProjectionCamera<Real>& camera) {
  return renderer::dot(s.normal, offset_of(camera, s.position_m)) > Real(0);
}

/// Spherical harmonics of surfel i before the clamp at 0.
/// @param basis  sh_basis() of the direction to the surfel, active degree.
template <class Real>
SEGSIM_HD inline renderer::Vec3<Real> unclamped_colour(const SurfelParameters<Real>& surfels,
                                                       std::int64_t i, const Real* basis) {
  const int stored = (surfels.sh_degree + 1) * (surfels.sh_degree + 1);
  const int used = (surfels.active_sh_degree + 1) * (surfels.active_sh_degree + 1);
  const Real* sh = surfels.sh + i * stored * 3;
  renderer::Vec3<Real> sum{Real(0.5), Real(0.5), Real(0.5)};
  for (int k = 0; k < used; ++k) {
    sum.x += basis[k] * sh[3 * k];
    sum.y += basis[k] * sh[3 * k + 1];
    sum.z += basis[k] * sh[3 * k + 2];
  }
  return sum;
}

/// @return  Colour of surfel i seen from the camera.
template <class Real>
SEGSIM_HD inline renderer::Vec3<Real> colour_of(
    const SurfelParameters<Real>& surfels, std::int64_t i,
    const renderer::ProjectionCamera<Real>& camera) {
  const renderer::Vec3<Real> offset = offset_of(camera, load_vec3(surfels.position_m, i));
  const renderer::Vec3<Real> direction =
      scaled(offset, Real(1) / std::sqrt(renderer::dot(offset, offset)));
  Real basis[16];
  renderer::sh_basis(surfels.active_sh_degree, direction, basis);
  const renderer::Vec3<Real> sum = unclamped_colour(surfels, i, basis);
  return {renderer::larger(sum.x, Real(0)), renderer::larger(sum.y, Real(0)),
          renderer::larger(sum.z, Real(0))};
}

/// What pixels read of a surfel, but for its colour (colour_of()).
/// @param screen  project_surfel() of it; its centre must lie beyond near_m.
/// @param k2  extent_squared() of its opacity, > 0.
template <class Real>
SEGSIM_HD inline DrawnSurfel<Real> drawn_surfel(
    const ActiveSurfel<Real>& s, const renderer::SurfelProjection<Real>& screen, Real k2,
    Real near_m, const renderer::ProjectionCamera<Real>& camera) {
  DrawnSurfel<Real> drawn;
  drawn.x0_px = screen.x0_px, drawn.y0_px = screen.y0_px;
  drawn.m00 = screen.m00, drawn.m01 = screen.m01;
  drawn.m10 = screen.m10, drawn.m11 = screen.m11;
  drawn.g0 = screen.g0, drawn.g1 = screen.g1;
  drawn.z0_m = screen.z0_m;
  drawn.opacity = s.opacity;
  drawn.k2 = k2;
  // inverse_depth_range(), such that e_max == e_near tells that the near plane decides.
  const Real reach = std::sqrt(k2 * (screen.w0 * screen.w0 + screen.w1 * screen.w1));
  drawn.e_near = screen.z0_m / near_m;
  drawn.e_min = Real(1) / (Real(1) + reach);
  drawn.e_max =
      (Real(1) - reach) * drawn.e_near > Real(1) ? Real(1) / (Real(1) - reach) : drawn.e_near;
  drawn.normal = scaled(s.normal, faces_away(s, camera) ? Real(-1) : Real(1));
  drawn.colour = {Real(0), Real(0), Real(0)};
  return drawn;
}

namespace detail {

/// Derivatives by a surfel's geometry.
template <class Real>
struct GeometryGradient {
  renderer::Vec3<Real> position, u, v;  ///< World frame; u, v: tangents times scales.
  Real k2;
};

template <class Real>
SEGSIM_HD inline renderer::Vec3<Real> to_world(const renderer::ProjectionCamera<Real>& c,
                                               Real x, Real y, Real z) {
  return {c.right.x * x + c.down.x * y + c.forward.x * z,
          c.right.y * x + c.down.y * y + c.forward.y * z,
          c.right.z * x + c.down.z * y + c.forward.z * z};
}

/// The file comment's way back through the projection.
/// @param u, v  Tangents times scales, world frame.
template <class Real>
SEGSIM_HD inline GeometryGradient<Real> projection_adjoint(
    const renderer::ProjectionCamera<Real>& camera, const renderer::Vec3<Real>& position_m,
    const renderer::Vec3<Real>& u, const renderer::Vec3<Real>& v, Real k2,
    const LocalGradient<Real>& local) {
  const renderer::SurfelProjection<Real> s =
      renderer::project_surfel(camera, position_m, u, v);
  GeometryGradient<Real> out;
  Real by_w0 = Real(0), by_w1 = Real(0);
  Real by_a0 = Real(0), by_a1 = Real(0), by_b0 = Real(0), by_b1 = Real(0);
  if (!s.edge_on) {
    by_w0 = s.m00 * local.g0 + s.m01 * local.g1;
    by_w1 = s.m10 * local.g0 + s.m11 * local.g1;
    const Real m00 = local.m00 + s.w0 * local.g0, m01 = local.m01 + s.w0 * local.g1;
    const Real m10 = local.m10 + s.w1 * local.g0, m11 = local.m11 + s.w1 * local.g1;
    // D_M M^T, then -M^T times it; J = [a; b].
    const Real p00 = m00 * s.m00 + m01 * s.m01, p01 = m00 * s.m10 + m01 * s.m11;
    const Real p10 = m10 * s.m00 + m11 * s.m01, p11 = m10 * s.m10 + m11 * s.m11;
    by_a0 = -(s.m00 * p00 + s.m10 * p10);
    by_a1 = -(s.m00 * p01 + s.m10 * p11);
    by_b0 = -(s.m01 * p00 + s.m11 * p10);
    by_b1 = -(s.m01 * p01 + s.m11 * p11);
  }
  const Real w_length = std::sqrt(s.w0 * s.w0 + s.w1 * s.w1), k = std::sqrt(k2);
  if (w_length > Real(0)) {
    by_w0 += local.reach * k * s.w0 / w_length;
    by_w1 += local.reach * k * s.w1 / w_length;
  }
  out.k2 = local.reach * w_length / (Real(2) * k);

  const renderer::Vec3<Real> offset = offset_of(camera, position_m);
  const Real inverse_z = Real(1) / s.z0_m;
  const Real x = renderer::dot(camera.right, offset), y = renderer::dot(camera.down, offset);
  const Real xn = x * inverse_z, yn = y * inverse_z;
  const Real fx = camera.fx_px, fy = camera.fy_px;
  const Real by_xn = fx * (local.x0 - (s.w0 * by_a0 + s.w1 * by_a1));
  const Real by_yn = fy * (local.y0 - (s.w0 * by_b0 + s.w1 * by_b1));
  by_w0 -= fx * xn * by_a0 + fy * yn * by_b0;
  by_w1 -= fx * xn * by_a1 + fy * yn * by_b1;
  const Real by_ux = fx * by_a0, by_uy = fy * by_b0;  // Times z0, as by_w.
  const Real by_vx = fx * by_a1, by_vy = fy * by_b1;
  const Real by_inverse_z =
      (renderer::dot(camera.right, u) * by_ux + renderer::dot(camera.down, u) * by_uy +
       renderer::dot(camera.forward, u) * by_w0) +
      (renderer::dot(camera.right, v) * by_vx + renderer::dot(camera.down, v) * by_vy +
       renderer::dot(camera.forward, v) * by_w1) +
      (x * by_xn + y * by_yn);
  out.position = to_world(camera, by_xn * inverse_z, by_yn * inverse_z,
                          local.z0 - by_inverse_z * inverse_z * inverse_z);
  out.u = to_world(camera, by_ux * inverse_z, by_uy * inverse_z, by_w0 * inverse_z);
  out.v = to_world(camera, by_vx * inverse_z, by_vy * inverse_z, by_w1 * inverse_z);
  return out;
}

/// By the raw quaternion, from derivatives by the columns of its rotation matrix.
template <class Real>
SEGSIM_HD inline void rotation_adjoint(const ActiveSurfel<Real>& s,
                                       const renderer::Vec3<Real>& by_t_u,
                                       const renderer::Vec3<Real>& by_t_v,
                                       const renderer::Vec3<Real>& by_normal, Real* rotation) {
  const Real w = s.w, x = s.x, y = s.y, z = s.z, two = Real(2);
  const renderer::Vec3<Real>&c0 = by_t_u, &c1 = by_t_v, &c2 = by_normal;
  const Real by_w = two * (x * (c1.z - c2.y) + y * (c2.x - c0.z) + z * (c0.y - c1.x));
  const Real by_x = two * (-two * x * (c1.y + c2.z) + y * (c0.y + c1.x) + z * (c0.z + c2.x) +
                           w * (c1.z - c2.y));
  const Real by_y = two * (-two * y * (c0.x + c2.z) + x * (c0.y + c1.x) + z * (c1.z + c2.y) +
                           w * (c2.x - c0.z));
  const Real by_z = two * (-two * z * (c0.x + c1.y) + x * (c0.z + c2.x) + y * (c1.z + c2.y) +
                           w * (c0.y - c1.x));
  const Real along = (w * by_w + x * by_x) + (y * by_y + z * by_z);
  rotation[0] = (by_w - w * along) * s.inverse_length;
  rotation[1] = (by_x - x * along) * s.inverse_length;
  rotation[2] = (by_y - y * along) * s.inverse_length;
  rotation[3] = (by_z - z * along) * s.inverse_length;
}

/// Writes the derivatives by the coefficients of surfel i; may be over the coefficients.
/// @return  By the position, through the direction of view.
template <class Real>
SEGSIM_HD inline renderer::Vec3<Real> colour_adjoint(
    const SurfelParameters<Real>& surfels, std::int64_t i,
    const renderer::ProjectionCamera<Real>& camera, const renderer::Vec3<Real>& by_colour,
    Real* sh_gradient) {
  const int stored = (surfels.sh_degree + 1) * (surfels.sh_degree + 1);
  const int used = (surfels.active_sh_degree + 1) * (surfels.active_sh_degree + 1);
  const renderer::Vec3<Real> offset = offset_of(camera, load_vec3(surfels.position_m, i));
  const Real inverse_distance = Real(1) / std::sqrt(renderer::dot(offset, offset));
  const renderer::Vec3<Real> direction = scaled(offset, inverse_distance);
  Real basis[16];
  renderer::sh_basis(surfels.active_sh_degree, direction, basis);
  const renderer::Vec3<Real> colour = unclamped_colour(surfels, i, basis);
  const renderer::Vec3<Real> by{colour.x > Real(0) ? by_colour.x : Real(0),
                                colour.y > Real(0) ? by_colour.y : Real(0),
                                colour.z > Real(0) ? by_colour.z : Real(0)};
  const Real* sh = surfels.sh + i * stored * 3;
  Real* out = sh_gradient + i * stored * 3;
  Real by_basis[16];
  for (int k = 0; k < used; ++k) {
    by_basis[k] = (sh[3 * k] * by.x + sh[3 * k + 1] * by.y) + sh[3 * k + 2] * by.z;
    out[3 * k] = basis[k] * by.x;
    out[3 * k + 1] = basis[k] * by.y;
    out[3 * k + 2] = basis[k] * by.z;
  }
  for (int k = 3 * used; k < 3 * stored; ++k) out[k] = Real(0);
  if (surfels.active_sh_degree == 0) return {Real(0), Real(0), Real(0)};
  const renderer::Vec3<Real> by_direction =
      sh_basis_adjoint(surfels.active_sh_degree, direction, by_basis);
  const Real along = renderer::dot(by_direction, direction);
  return {(by_direction.x - along * direction.x) * inverse_distance,
          (by_direction.y - along * direction.y) * inverse_distance,
          (by_direction.z - along * direction.z) * inverse_distance};
}

}  // namespace detail

/// Writes all derivatives of surfel i, which was drawn; `gradients.screen` may be null.
/// @param width_px, height_px  Of the image: units of `screen`.
template <class Real>
SEGSIM_HD inline void write_gradients(const SurfelParameters<Real>& surfels, std::int64_t i,
                                      const renderer::ProjectionCamera<Real>& camera,
                                      int width_px, int height_px,
                                      const LocalGradient<Real>& local,
                                      const SurfelGradients<Real>& gradients) {
  const ActiveSurfel<Real> s = activate(surfels, i);
  const renderer::Vec3<Real> u = scaled(s.t_u, s.scale_u_m), v = scaled(s.t_v, s.scale_v_m);
  const detail::GeometryGradient<Real> by = detail::projection_adjoint(
      camera, s.position_m, u, v, renderer::extent_squared(s.opacity), local);
  const renderer::Vec3<Real> by_view =
      detail::colour_adjoint(surfels, i, camera, local.colour, gradients.sh);
  gradients.position_m[3 * i] = by.position.x + by_view.x;
  gradients.position_m[3 * i + 1] = by.position.y + by_view.y;
  gradients.position_m[3 * i + 2] = by.position.z + by_view.z;
  gradients.log_scale[2 * i] = renderer::dot(by.u, u);
  gradients.log_scale[2 * i + 1] = renderer::dot(by.v, v);
  const Real side = faces_away(s, camera) ? Real(-1) : Real(1);
  detail::rotation_adjoint(s, scaled(by.u, s.scale_u_m), scaled(by.v, s.scale_v_m),
                           scaled(local.normal, side), gradients.rotation + 4 * i);
  // k2 = 2 ln(255 o), d ln(o) / d logit = 1 - o
  gradients.opacity_logit[i] = (local.log_opacity + Real(2) * by.k2) * (Real(1) - s.opacity);
  if (gradients.screen != nullptr) {
    const Real x = local.x0 * Real(0.5) * static_cast<Real>(width_px);
    const Real y = local.y0 * Real(0.5) * static_cast<Real>(height_px);
    gradients.screen[i] = std::sqrt(x * x + y * y);
  }
}

/// The same for a surfel that no pixel shows.
template <class Real>
SEGSIM_HD inline void write_zero_gradients(const SurfelParameters<Real>& surfels,
                                           std::int64_t i,
                                           const SurfelGradients<Real>& gradients) {
  const int sh_values = 3 * (surfels.sh_degree + 1) * (surfels.sh_degree + 1);
  for (int k = 0; k < 3; ++k) gradients.position_m[3 * i + k] = Real(0);
  for (int k = 0; k < 2; ++k) gradients.log_scale[2 * i + k] = Real(0);
  for (int k = 0; k < 4; ++k) gradients.rotation[4 * i + k] = Real(0);
  gradients.opacity_logit[i] = Real(0);
  for (int k = 0; k < sh_values; ++k) gradients.sh[i * sh_values + k] = Real(0);
  if (gradients.screen != nullptr) gradients.screen[i] = Real(0);
}

}  // namespace segsim::reconstruction
