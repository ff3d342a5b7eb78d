#pragma once

/// @file
/// One pixel: its meeting with a surfel, the blending, and the derivatives of both. Compiled
/// by the host and by a GPU, in float and in double.
///
/// Forward is surfel_geometry.h, with d = pixel centre - (x0, y0):
///
///     q = M d,  e = 1 - g.d,  rho = min(|q|^2 / e^2, 2 |d|^2),  alpha = min(0.99, o exp(-rho
///     / 2)),  depth = z0 / e with e brought into [e_min, e_max]
///
/// The images of a pixel are sums of w_k f_k, w_k = alpha_k T_k. Their loss is linear in the
/// weights: a surfel adds w_k v_k,
///
///     v_k = L_rgb.c_k + L_depth z_k + L_alpha + L_normal.n_k
///           + L_distortion (M2 + A m_k^2 - 2 M1 m_k) + L_k
///
/// with L the loss's derivatives by the pixel's images, and L_k that by the weight itself, if
/// there is one. The last term is the derivative of the
/// distortion A M2 - M1^2 by w_k, where A, M1, M2 = sum of w, w m, w m^2 over the whole pixel.
/// All later weights contain (1 - alpha_k), so
///
///     dL/dalpha_k = T_k v_k - R_k / (1 - alpha_k),  R_k = sum of w_j v_j over later j
///
/// R before the first surfel follows from the pixel's sums alone (remaining_value()), so we go
/// through the list front to back, take w_k v_k from R and multiply T as forward did: no
/// division restores T, and the surfels are the same, bit by bit. The running state is (T, R);
/// a walk may also start in the middle of a list, from the sums up to there.
///
/// m = far / (far - near) (1 - near / z) enters through differences only, so it is measured
/// from that of the first surfel of the pixel: of 0.93 and 0.9302 a float would keep nothing
/// when squared.

#include <cmath>

#include "core/host_device.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::reconstruction {

/// m_j - m_i = kDistortionScale (1 / z_i - 1 / z_j), from near 0.2 m and far 100 m.
inline constexpr double kDistortionScale = 0.2 * 100.0 / (100.0 - 0.2);

/// A surfel as the pixel loop reads it.
template <class Real>
struct DrawnSurfel {
  Real x0_px, y0_px;
  Real m00, m01, m10, m11, g0, g1;
  Real z0_m, opacity, k2;
  Real e_min, e_max;  ///< inverse_depth_range()
  Real e_near;        ///< z0 / near; e_max equals it where the near plane cuts the disc.
  renderer::Vec3<Real> colour;  ///< >= 0
  renderer::Vec3<Real> normal;  ///< Unit, world frame, towards the camera.
};

enum class DepthLimit : unsigned char { kNone, kNear, kFar };

/// Where a pixel's ray meets a surfel.
template <class Real>
struct SurfelHit {
  Real dx_px, dy_px;  ///< d
  Real q0, q1, e;
  Real rho, alpha, depth_m;
  bool low_pass;       ///< rho = 2 |d|^2
  bool opaque;         ///< alpha is clamped.
  DepthLimit limited;  ///< Which end of [e_min, e_max] gave the depth.
};

/// @param x_px, y_px  Pixel centre.
/// @return  False if the surfel does not reach the pixel.
template <class Real>
SEGSIM_HD inline bool meet_surfel(const DrawnSurfel<Real>& s, Real x_px, Real y_px,
                                  SurfelHit<Real>& hit) {
  hit.dx_px = x_px - s.x0_px;
  hit.dy_px = y_px - s.y0_px;
  const Real rho_low_pass = Real(2) * (hit.dx_px * hit.dx_px + hit.dy_px * hit.dy_px);
  hit.q0 = s.m00 * hit.dx_px + s.m01 * hit.dy_px;
  hit.q1 = s.m10 * hit.dx_px + s.m11 * hit.dy_px;
  hit.e = Real(1) - (s.g0 * hit.dx_px + s.g1 * hit.dy_px);
  const Real qq = hit.q0 * hit.q0 + hit.q1 * hit.q1, ee = hit.e * hit.e;
  const bool on_disc = hit.e > Real(0) && hit.e <= s.e_near && qq <= s.k2 * ee;
  if (!on_disc && !(rho_low_pass <= s.k2)) return false;
  hit.low_pass = !on_disc || rho_low_pass * ee < qq;
  hit.rho = hit.low_pass ? rho_low_pass : qq / ee;
  const Real alpha = s.opacity * std::exp(Real(-0.5) * hit.rho);
  hit.opaque = alpha > Real(renderer::kMaxAlpha);
  hit.alpha = hit.opaque ? Real(renderer::kMaxAlpha) : alpha;
  hit.limited = hit.e < s.e_min   ? DepthLimit::kFar
                : hit.e > s.e_max ? DepthLimit::kNear
                                  : DepthLimit::kNone;
  hit.depth_m = s.z0_m / (hit.limited == DepthLimit::kFar    ? s.e_min
                          : hit.limited == DepthLimit::kNear ? s.e_max
                                                             : hit.e);
  return true;
}

/// Sums over the surfels of a pixel so far.
template <class Real>
struct PixelSums {
  Real transmittance = Real(1);
  renderer::Vec3<Real> rgb{Real(0), Real(0), Real(0)};
  Real depth_m = Real(0);
  renderer::Vec3<Real> normal{Real(0), Real(0), Real(0)};
  Real m1 = Real(0), m2 = Real(0);     ///< Of m from that of the first surfel.
  Real first_inverse_depth = Real(0);  ///< [1/m] of the first surfel; 0 = none yet.
  Real median_m = Real(0);
};

template <class Real>
SEGSIM_HD inline Real distortion_of(const PixelSums<Real>& sums) {
  return (Real(1) - sums.transmittance) * sums.m2 - sums.m1 * sums.m1;
}

/// m of a hit, from that of the first surfel of the pixel.
template <class Real>
SEGSIM_HD inline Real distortion_depth(Real first_inverse_depth, Real depth_m) {
  return Real(kDistortionScale) * (first_inverse_depth - Real(1) / depth_m);
}

/// Adds a hit to the pixel.
/// @return  Its weight; negative if the pixel is finished instead: this surfel and all behind
///     it are not blended.
template <class Real>
SEGSIM_HD inline Real blend_hit(const DrawnSurfel<Real>& s, const SurfelHit<Real>& hit,
                                PixelSums<Real>& sums) {
  const Real left = sums.transmittance * (Real(1) - hit.alpha);
  if (left < Real(renderer::kStopTransmittance)) return Real(-1);
  const Real w = sums.transmittance * hit.alpha;
  const Real half = Real(1) - Real(renderer::kMinSurfaceAlpha);
  if (sums.transmittance > half && left <= half) sums.median_m = hit.depth_m;
  if (sums.first_inverse_depth == Real(0)) sums.first_inverse_depth = Real(1) / hit.depth_m;
  const Real m = distortion_depth(sums.first_inverse_depth, hit.depth_m);
  sums.transmittance = left;
  sums.rgb.x += w * s.colour.x;
  sums.rgb.y += w * s.colour.y;
  sums.rgb.z += w * s.colour.z;
  sums.depth_m += w * hit.depth_m;
  sums.normal.x += w * s.normal.x;
  sums.normal.y += w * s.normal.y;
  sums.normal.z += w * s.normal.z;
  sums.m1 += w * m;
  sums.m2 += w * m * m;
  return w;
}

/// Derivatives of the loss by the images at one pixel.
template <class Real>
struct PixelLoss {
  renderer::Vec3<Real> rgb;
  Real depth_m, alpha;
  renderer::Vec3<Real> normal;
  Real distortion;
};

/// R of the file comment: sum of w v over the surfels that are in `all` and not in `before`.
/// @param all  Of the whole pixel.
/// @param before  Of the surfels up to some place of the list; default-constructed = none.
template <class Real>
SEGSIM_HD inline Real remaining_value(const PixelLoss<Real>& loss, const PixelSums<Real>& all,
                                      const PixelSums<Real>& before) {
  const auto minus = [](const renderer::Vec3<Real>& a, const renderer::Vec3<Real>& b) {
    return renderer::Vec3<Real>{a.x - b.x, a.y - b.y, a.z - b.z};
  };
  const Real alpha = before.transmittance - all.transmittance;
  const Real distortion = all.m2 * alpha +
                          (Real(1) - all.transmittance) * (all.m2 - before.m2) -
                          Real(2) * all.m1 * (all.m1 - before.m1);
  return renderer::dot(loss.rgb, minus(all.rgb, before.rgb)) +
         loss.depth_m * (all.depth_m - before.depth_m) + loss.alpha * alpha +
         renderer::dot(loss.normal, minus(all.normal, before.normal)) +
         loss.distortion * distortion;
}

/// A pixel on its way through the list, front to back.
template <class Real>
struct PixelAdjoint {
  PixelLoss<Real> loss;
  Real alpha, m1, m2, first_inverse_depth;  ///< Of the whole pixel.
  Real transmittance;                       ///< T before the next surfel.
  Real remaining;                           ///< Sum of w v from the next surfel on.
};

template <class Real>
SEGSIM_HD inline PixelAdjoint<Real> begin_adjoint(const PixelLoss<Real>& loss,
                                                  const PixelSums<Real>& all,
                                                  const PixelSums<Real>& before = {}) {
  return {loss,
          Real(1) - all.transmittance,
          all.m1,
          all.m2,
          all.first_inverse_depth,
          before.transmittance,
          remaining_value(loss, all, before)};
}

/// Derivatives of the loss by what a pixel takes from a surfel.
template <class Real>
struct HitGradient {
  Real weight;  ///< w: times loss.rgb and loss.normal it is that by colour and normal.
  Real alpha;   ///< By the alpha that was blended.
  Real depth_m;
};

/// The next surfel that forward blended into this pixel (its caller knows where it stopped).
/// @param by_weight  L_k.
template <class Real>
SEGSIM_HD inline HitGradient<Real> unblend_hit(const DrawnSurfel<Real>& s,
                                               const SurfelHit<Real>& hit,
                                               PixelAdjoint<Real>& pixel,
                                               Real by_weight = Real(0)) {
  const PixelLoss<Real>& loss = pixel.loss;
  const Real w = pixel.transmittance * hit.alpha;
  const Real inverse_depth = Real(1) / hit.depth_m;
  const Real m = Real(kDistortionScale) * (pixel.first_inverse_depth - inverse_depth);
  const Real value =
      renderer::dot(loss.rgb, s.colour) + loss.depth_m * hit.depth_m + loss.alpha +
      renderer::dot(loss.normal, s.normal) +
      loss.distortion * (pixel.m2 + m * (pixel.alpha * m - Real(2) * pixel.m1)) + by_weight;
  pixel.remaining -= w * value;
  HitGradient<Real> gradient;
  gradient.weight = w;
  gradient.alpha = pixel.transmittance * value - pixel.remaining / (Real(1) - hit.alpha);
  gradient.depth_m =
      w * (loss.depth_m + loss.distortion * Real(2 * kDistortionScale) *
                              (pixel.alpha * m - pixel.m1) * inverse_depth * inverse_depth);
  pixel.transmittance *= Real(1) - hit.alpha;
  return gradient;
}

/// Derivatives of the loss by the numbers of a DrawnSurfel, to be summed over its pixels.
template <class Real>
struct LocalGradient {
  Real m00 = 0, m01 = 0, m10 = 0, m11 = 0, g0 = 0, g1 = 0;
  Real x0 = 0, y0 = 0;  ///< By the projected centre [1/px], M and g held.
  Real z0 = 0;
  Real reach = 0;  ///< By k |w|: where e_min or e_max gave the depth.
  Real log_opacity = 0;
  renderer::Vec3<Real> colour{0, 0, 0}, normal{0, 0, 0};
};

/// Number of values of a LocalGradient, in the order of its members.
inline constexpr int kLocalGradientSize = 17;

template <class Real>
SEGSIM_HD inline void add(const LocalGradient<Real>& part, LocalGradient<Real>& sum) {
  sum.m00 += part.m00, sum.m01 += part.m01, sum.m10 += part.m10, sum.m11 += part.m11;
  sum.g0 += part.g0, sum.g1 += part.g1;
  sum.x0 += part.x0, sum.y0 += part.y0, sum.z0 += part.z0;
  sum.reach += part.reach, sum.log_opacity += part.log_opacity;
  sum.colour.x += part.colour.x, sum.colour.y += part.colour.y;
  sum.colour.z += part.colour.z, sum.normal.x += part.normal.x;
  sum.normal.y += part.normal.y, sum.normal.z += part.normal.z;
}

/// Adds what one pixel contributes.
template <class Real>
SEGSIM_HD inline void add_hit_gradient(const DrawnSurfel<Real>& s, const SurfelHit<Real>& hit,
                                       const PixelLoss<Real>& loss,
                                       const HitGradient<Real>& by, LocalGradient<Real>& sum) {
  sum.colour.x += by.weight * loss.rgb.x;
  sum.colour.y += by.weight * loss.rgb.y;
  sum.colour.z += by.weight * loss.rgb.z;
  sum.normal.x += by.weight * loss.normal.x;
  sum.normal.y += by.weight * loss.normal.y;
  sum.normal.z += by.weight * loss.normal.z;

  Real by_e = Real(0), by_dx = Real(0), by_dy = Real(0);
  if (hit.limited == DepthLimit::kNone) {
    // depth = z0 / e
    const Real inverse_e = Real(1) / hit.e;
    sum.z0 += by.depth_m * inverse_e;
    by_e -= by.depth_m * hit.depth_m * inverse_e;
  } else if (hit.limited == DepthLimit::kFar) {
    // depth = z0 (1 + k |w|)
    sum.z0 += by.depth_m / s.e_min;
    sum.reach += by.depth_m * s.z0_m;
  } else if (s.e_max != s.e_near) {
    // depth = z0 (1 - k |w|); else it is that of the near plane, which does not move.
    sum.z0 += by.depth_m / s.e_max;
    sum.reach -= by.depth_m * s.z0_m;
  }
  if (!hit.opaque) {
    const Real by_log_alpha = by.alpha * hit.alpha;
    const Real by_rho = Real(-0.5) * by_log_alpha;
    sum.log_opacity += by_log_alpha;
    if (hit.low_pass) {
      by_dx += Real(4) * by_rho * hit.dx_px;
      by_dy += Real(4) * by_rho * hit.dy_px;
    } else {
      const Real inverse_e = Real(1) / hit.e;
      const Real scale = Real(2) * by_rho * inverse_e * inverse_e;
      const Real by_q0 = scale * hit.q0, by_q1 = scale * hit.q1;
      by_e -= Real(2) * by_rho * hit.rho * inverse_e;
      sum.m00 += by_q0 * hit.dx_px;
      sum.m01 += by_q0 * hit.dy_px;
      sum.m10 += by_q1 * hit.dx_px;
      sum.m11 += by_q1 * hit.dy_px;
      by_dx += s.m00 * by_q0 + s.m10 * by_q1;
      by_dy += s.m01 * by_q0 + s.m11 * by_q1;
    }
  }
  // e = 1 - g.d, d = pixel - (x0, y0)
  sum.g0 -= by_e * hit.dx_px;
  sum.g1 -= by_e * hit.dy_px;
  sum.x0 -= by_dx - by_e * s.g0;
  sum.y0 -= by_dy - by_e * s.g1;
}

}  // namespace segsim::reconstruction
