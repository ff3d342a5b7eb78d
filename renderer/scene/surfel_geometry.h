#pragma once

/// @file
/// How a surfel meets the screen: projection, exact outline, tiles. The same functions serve
/// the CPU renderer (float), the tests (double) and a GPU.
///
/// A surfel is the disc p(u) = p + s_u t_u u_0 + s_v t_v u_1, |u| <= k, where k^2 = 2 ln(255
/// o) is the squared radius at which alpha falls to 1/255. Write its centre in the camera as
/// (X, Y, z0) and let d be an image offset from the projected centre (x0, y0). Then
///
///     w = (s_u t_u.z, s_v t_v.z) / z0            relative depth change per sigma
///     J = [a; b]                                  2x2, pixels per sigma
///     a = fx ((s_u t_u.x, s_v t_v.x) / z0 - X/z0 w),   b likewise in y
///     M = J^-1,  g = J^-T w
///     q = M d,  e = 1 - g.d,  u = q / e,  rho = |q|^2 / e^2,  depth = z0 / e
///
/// which is Huang et al. 2024 eq. 8-10 in a local frame: no cancellation, no division before
/// the hit test |q|^2 <= k^2 e^2. The outline of the disc on screen is, with D = 1 - k^2 |w|^2
/// > 0 and G = k^2 / D, exactly the ellipse with
///
///     centre - (x0, y0) = c' = -G J w,     shape S = G J J^T + c' c'^T
///
/// (the image of the disc's dual conic diag(k^2, k^2, -1), normalised). The paper's Sigma' of
/// the precise tile intersection is the idea; its printed form mixes units, so we use the
/// exact conic.
///
/// Low pass: a surfel is never drawn thinner than a Gaussian of 1/sqrt(2) px about (x0, y0),
/// so rho = min(rho, 2 |d|^2). (The 2DGS code centres it on a bounding box instead.)

#include <cmath>

#include "core/host_device.h"

namespace segsim::renderer {

template <class Real>
struct Vec3 {
  Real x, y, z;
};

template <class Real>
SEGSIM_HD inline Real dot(const Vec3<Real>& a, const Vec3<Real>& b) {
  // The order of these three operations is that of the SIMD code: see depth_of_centre().
  return (a.x * b.x + a.y * b.y) + a.z * b.z;
}

/// Without the NaN rules of std::fmin, which compile to a call.
template <class Real>
SEGSIM_HD inline Real lesser(Real a, Real b) {
  return a < b ? a : b;
}
template <class Real>
SEGSIM_HD inline Real larger(Real a, Real b) {
  return a > b ? a : b;
}

/// Camera in the form that projection wants: rows of R_camera_world and the pinhole
/// parameters.
template <class Real>
struct ProjectionCamera {
  Vec3<Real> right, down, forward;  ///< Unit, world frame.
  Vec3<Real> centre_m;              ///< World frame.
  Real fx_px, fy_px, cx_px, cy_px;
};

/// Depth along +z of a surfel's centre; the order in which surfels are blended. Evaluated in
/// float by every renderer, with exactly these operations, so that all agree on the order.
template <class Real>
SEGSIM_HD inline Real depth_of_centre(const ProjectionCamera<Real>& camera,
                                      const Vec3<Real>& position_m) {
  return dot(camera.forward,
             Vec3<Real>{position_m.x - camera.centre_m.x, position_m.y - camera.centre_m.y,
                        position_m.z - camera.centre_m.z});
}

/// A surfel on the screen, in the local form of the file comment.
template <class Real>
struct SurfelProjection {
  Real x0_px, y0_px, z0_m;
  Real a0, a1, b0, b1;  ///< J = [a0 a1; b0 b1]
  Real w0, w1;
  Real m00, m01, m10, m11;  ///< M
  Real g0, g1;
  bool edge_on;  ///< Seen as a line: drawn by the low pass only.
};

/// |det J| below this times |J|^2 counts as edge-on: the disc is then far thinner than the low
/// pass, and M would be noise in float.
inline constexpr float kEdgeOn = 1e-4F;
/// Entry of M for an edge-on surfel: makes rho larger than the low pass everywhere.
inline constexpr float kEdgeOnInverse = 1e10F;
/// Bounds use k^2 times this, so that in float no bound is inside the per-pixel test.
inline constexpr float kBoundSlack = 1.00001F;

/// @param su_tu_m, sv_tv_m  Tangents times scales, world frame. The centre must have z > 0.
template <class Real>
SEGSIM_HD inline SurfelProjection<Real> project_surfel(const ProjectionCamera<Real>& camera,
                                                       const Vec3<Real>& position_m,
                                                       const Vec3<Real>& su_tu_m,
                                                       const Vec3<Real>& sv_tv_m) {
  SurfelProjection<Real> s;
  s.z0_m = depth_of_centre(camera, position_m);
  const Vec3<Real> offset{position_m.x - camera.centre_m.x, position_m.y - camera.centre_m.y,
                          position_m.z - camera.centre_m.z};
  const Real inverse_z = Real(1) / s.z0_m;
  const Real xn = dot(camera.right, offset) * inverse_z;
  const Real yn = dot(camera.down, offset) * inverse_z;
  s.w0 = dot(camera.forward, su_tu_m) * inverse_z;
  s.w1 = dot(camera.forward, sv_tv_m) * inverse_z;
  s.a0 = camera.fx_px * (dot(camera.right, su_tu_m) * inverse_z - xn * s.w0);
  s.a1 = camera.fx_px * (dot(camera.right, sv_tv_m) * inverse_z - xn * s.w1);
  s.b0 = camera.fy_px * (dot(camera.down, su_tu_m) * inverse_z - yn * s.w0);
  s.b1 = camera.fy_px * (dot(camera.down, sv_tv_m) * inverse_z - yn * s.w1);
  s.x0_px = camera.fx_px * xn + camera.cx_px;
  s.y0_px = camera.fy_px * yn + camera.cy_px;

  const Real det = s.a0 * s.b1 - s.a1 * s.b0;
  const Real norm2 = s.a0 * s.a0 + s.a1 * s.a1 + s.b0 * s.b0 + s.b1 * s.b1;
  s.edge_on = !(std::abs(det) >= Real(kEdgeOn) * norm2) || det == Real(0);
  if (s.edge_on) {
    s.m00 = s.m11 = Real(kEdgeOnInverse);
    s.m01 = s.m10 = s.g0 = s.g1 = Real(0);
    return s;
  }
  const Real inverse_det = Real(1) / det;
  s.m00 = s.b1 * inverse_det;
  s.m01 = -s.a1 * inverse_det;
  s.m10 = -s.b0 * inverse_det;
  s.m11 = s.a0 * inverse_det;
  s.g0 = s.w0 * s.m00 + s.w1 * s.m10;
  s.g1 = s.w0 * s.m01 + s.w1 * s.m11;
  return s;
}

/// k^2 = 2 ln(255 o); not positive for a surfel that is too faint to be seen.
template <class Real>
SEGSIM_HD inline Real extent_squared(Real opacity) {
  return Real(2) * std::log(Real(255) * opacity);
}

/// Axis-aligned rectangle in image coordinates.
template <class Real>
struct ScreenBox {
  Real x_min_px, x_max_px, y_min_px, y_max_px;
};

/// {x : (x - c)^T S^-1 (x - c) <= 1}; the half extents are sqrt(sxx), sqrt(syy).
template <class Real>
struct ScreenEllipse {
  Real cx_px, cy_px;
  Real sxx, sxy, syy;  ///< [px^2]
};

/// Does part of the disc lie nearer than `near_m`? Its outline is then not an ellipse.
template <class Real>
SEGSIM_HD inline bool crosses_near_plane(const SurfelProjection<Real>& s, Real k2,
                                         Real near_m) {
  return Real(1) - std::sqrt(k2 * (s.w0 * s.w0 + s.w1 * s.w1)) < near_m / s.z0_m;
}

/// The exact outline of the disc; it must not cross the near plane.
template <class Real>
SEGSIM_HD inline ScreenEllipse<Real> outline_of_disc(const SurfelProjection<Real>& s,
                                                     Real k2) {
  const Real g = k2 / (Real(1) - k2 * (s.w0 * s.w0 + s.w1 * s.w1));
  const Real x = -g * (s.a0 * s.w0 + s.a1 * s.w1);
  const Real y = -g * (s.b0 * s.w0 + s.b1 * s.w1);
  return {s.x0_px + x, s.y0_px + y, g * (s.a0 * s.a0 + s.a1 * s.a1) + x * x,
          g * (s.a0 * s.b0 + s.a1 * s.b1) + x * y, g * (s.b0 * s.b0 + s.b1 * s.b1) + y * y};
}

template <class Real>
SEGSIM_HD inline ScreenBox<Real> box_of(const ScreenEllipse<Real>& ellipse) {
  const Real half_width = std::sqrt(ellipse.sxx);
  const Real half_height = std::sqrt(ellipse.syy);
  return {ellipse.cx_px - half_width, ellipse.cx_px + half_width, ellipse.cy_px - half_height,
          ellipse.cy_px + half_height};
}

/// Radius of the low-pass disc about (x0, y0).
template <class Real>
SEGSIM_HD inline Real low_pass_radius_px(Real k2) {
  return std::sqrt(Real(0.5) * k2);
}

template <class Real>
SEGSIM_HD inline ScreenBox<Real> with_low_pass(const ScreenBox<Real>& box,
                                               const SurfelProjection<Real>& s, Real k2) {
  const Real r = low_pass_radius_px(k2);
  return {lesser(box.x_min_px, s.x0_px - r), larger(box.x_max_px, s.x0_px + r),
          lesser(box.y_min_px, s.y0_px - r), larger(box.y_max_px, s.y0_px + r)};
}

namespace detail {

/// Widens [lo, hi] by the offset at which tangent lines of the disc's image with normal `a`
/// touch it, if the contact lies beyond the near plane. The tangent offsets are the roots x of
/// D x^2 + 2 B x - C = 0, B = k^2 a.w, C = k^2 |a|^2, with contact u = k^2 (a - x w) / x.
template <class Real>
SEGSIM_HD inline void widen_by_tangents(Real a0, Real a1, Real w0, Real w1, Real k2, Real nu,
                                        Real& lo, Real& hi) {
  const Real d = Real(1) - k2 * (w0 * w0 + w1 * w1);
  const Real b = k2 * (a0 * w0 + a1 * w1);
  const Real c = k2 * (a0 * a0 + a1 * a1);
  const Real discriminant = b * b + d * c;
  if (discriminant < Real(0)) return;
  const Real q = -(b + (b < Real(0) ? Real(-1) : Real(1)) * std::sqrt(discriminant));
  const Real roots[2] = {d != Real(0) ? q / d : Real(0), q != Real(0) ? -c / q : Real(0)};
  for (const Real x : roots) {
    if (x == Real(0) || !std::isfinite(x)) continue;
    const Real u0 = k2 * (a0 - x * w0) / x;
    const Real u1 = k2 * (a1 - x * w1) / x;
    if (Real(1) + w0 * u0 + w1 * u1 < nu * Real(0.999)) continue;
    lo = lesser(lo, x);
    hi = larger(hi, x);
  }
}

}  // namespace detail

/// Box of the part of the disc beyond the near plane, for a disc that crosses it and whose
/// centre is beyond it: extremes are tangent points or the two ends of the cut.
template <class Real>
SEGSIM_HD inline ScreenBox<Real> box_of_clipped_disc(const SurfelProjection<Real>& s, Real k2,
                                                     Real near_m) {
  const Real nu = near_m / s.z0_m;
  const Real w = std::sqrt(s.w0 * s.w0 + s.w1 * s.w1);
  const Real along = (nu - Real(1)) / w;
  const Real across = std::sqrt(larger(Real(0), k2 - along * along));
  Real x_lo = 0, x_hi = 0, y_lo = 0, y_hi = 0;  // The centre itself is visible.
  for (int end = -1; end <= 1; end += 2) {
    const Real u0 = (along * s.w0 - Real(end) * across * s.w1) / w;
    const Real u1 = (along * s.w1 + Real(end) * across * s.w0) / w;
    const Real x = (s.a0 * u0 + s.a1 * u1) / nu;
    const Real y = (s.b0 * u0 + s.b1 * u1) / nu;
    x_lo = lesser(x_lo, x);
    x_hi = larger(x_hi, x);
    y_lo = lesser(y_lo, y);
    y_hi = larger(y_hi, y);
  }
  detail::widen_by_tangents(s.a0, s.a1, s.w0, s.w1, k2, nu, x_lo, x_hi);
  detail::widen_by_tangents(s.b0, s.b1, s.w0, s.w1, k2, nu, y_lo, y_hi);
  return {s.x0_px + x_lo, s.x0_px + x_hi, s.y0_px + y_lo, s.y0_px + y_hi};
}

/// Columns that the surfel (ellipse united with its low-pass disc) covers in a band of rows.
template <class Real>
struct ColumnSpan {
  Real x_min_px, x_max_px;  ///< x_min > x_max: nothing.
};

/// @param low_pass_x_px, low_pass_y_px, low_pass_radius2  The low-pass disc.
/// @param y_lo_px, y_hi_px  First and last pixel centre of the band. By convexity the extreme
///     column lies at the ellipse's own extreme, moved into the band.
template <class Real>
SEGSIM_HD inline ColumnSpan<Real> columns_in_band(const ScreenEllipse<Real>& ellipse,
                                                  Real low_pass_x_px, Real low_pass_y_px,
                                                  Real low_pass_radius2, Real y_lo_px,
                                                  Real y_hi_px) {
  ColumnSpan<Real> span{Real(1e30), Real(-1e30)};
  const Real half_height = std::sqrt(ellipse.syy);
  const Real lo = larger(y_lo_px - ellipse.cy_px, -half_height);
  const Real hi = lesser(y_hi_px - ellipse.cy_px, half_height);
  if (lo <= hi && ellipse.syy > Real(0)) {
    const Real slope = ellipse.sxy / ellipse.syy;
    const Real minor = larger(Real(0), ellipse.sxx - ellipse.sxy * slope);
    const Real y_extreme =
        ellipse.sxx > Real(0) ? ellipse.sxy / std::sqrt(ellipse.sxx) : Real(0);
    const Real y_right = lesser(larger(y_extreme, lo), hi);
    const Real y_left = lesser(larger(-y_extreme, lo), hi);
    span.x_max_px =
        ellipse.cx_px + slope * y_right +
        std::sqrt(larger(Real(0), minor * (Real(1) - y_right * y_right / ellipse.syy)));
    span.x_min_px =
        ellipse.cx_px + slope * y_left -
        std::sqrt(larger(Real(0), minor * (Real(1) - y_left * y_left / ellipse.syy)));
  }
  const Real dy = larger(larger(y_lo_px - low_pass_y_px, low_pass_y_px - y_hi_px), Real(0));
  if (dy * dy <= low_pass_radius2) {
    const Real h = std::sqrt(low_pass_radius2 - dy * dy);
    span.x_min_px = lesser(span.x_min_px, low_pass_x_px - h);
    span.x_max_px = larger(span.x_max_px, low_pass_x_px + h);
  }
  return span;
}

/// The paper's precise tile intersection in the one reading that has the units of an area: its
/// Sigma' with rows relative to the projected centre, which is the affine ("EWA")
/// approximation k^2 J J^T. It takes perspective stretch and the shift of the centre for 0 and
/// knows no near plane, so lists made from it may miss pixels. For comparison only.
template <class Real>
SEGSIM_HD inline ScreenEllipse<Real> paper_outline(const SurfelProjection<Real>& s, Real k2) {
  return {s.x0_px, s.y0_px, k2 * (s.a0 * s.a0 + s.a1 * s.a1), k2 * (s.a0 * s.b0 + s.a1 * s.b1),
          k2 * (s.b0 * s.b0 + s.b1 * s.b1)};
}

/// The box of the image of |u| = k from its dual conic, as both 2DGS programs compute it:
/// where the disc reaches the camera plane it is a hyperbola, and centre and extents are those
/// of no ellipse.
template <class Real>
struct ConicBox {
  Real cx_px, cy_px;
  Real half_width_px, half_height_px;  ///< >= 0.01
  bool valid;                          ///< False: the conic is a parabola; both drop it.
};

template <class Real>
SEGSIM_HD inline ConicBox<Real> box_of_dual_conic(const SurfelProjection<Real>& s, Real k2) {
  constexpr double kMinHalf2 = 1e-4;  // [px^2]
  const Real d = Real(1) - k2 * (s.w0 * s.w0 + s.w1 * s.w1);
  const Real g = k2 / d;
  const Real x = -g * (s.a0 * s.w0 + s.a1 * s.w1);
  const Real y = -g * (s.b0 * s.w0 + s.b1 * s.w1);
  const Real half_width2 = x * x + g * (s.a0 * s.a0 + s.a1 * s.a1);
  const Real half_height2 = y * y + g * (s.b0 * s.b0 + s.b1 * s.b1);
  return {s.x0_px + x, s.y0_px + y, std::sqrt(larger(half_width2, Real(kMinHalf2))),
          std::sqrt(larger(half_height2, Real(kMinHalf2))), d != Real(0)};
}

/// Half a side of the square of hbb1/diff-surfel-rasterization, from the box at k^2 = 9: the
/// larger half extent or three sigmas of the low pass, rounded up to pixels.
template <class Real>
SEGSIM_HD inline Real half_of_3_sigma_square(const ConicBox<Real>& box) {
  constexpr double kThreeLowPassSigmas = 3.0 * 0.707106;  // [px]
  return std::ceil(
      larger(larger(box.half_width_px, box.half_height_px), Real(kThreeLowPassSigmas)));
}

/// That square. It misses contributions beyond 3 sigma (alpha <= 0.011), and most of a disc
/// that reaches through the camera plane. Empty (x_min > x_max) for a parabola. The tiles that
/// the 2DGS code lists for it: tiles_of_square() in internal/compat_rules.h.
template <class Real>
SEGSIM_HD inline ScreenBox<Real> aabb_3_sigma(const SurfelProjection<Real>& s) {
  const ConicBox<Real> box = box_of_dual_conic(s, Real(9));
  if (!box.valid) return {Real(1e30), Real(-1e30), Real(1e30), Real(-1e30)};
  const Real half = half_of_3_sigma_square(box);
  return {box.cx_px - half, box.cx_px + half, box.cy_px - half, box.cy_px + half};
}

/// Range of e = z0 / depth over the drawn disc. Where the low pass decides, the plane's depth
/// at the pixel can be anything, so it is brought into this range; on the disc itself that
/// changes nothing.
template <class Real>
struct InverseDepthRange {
  Real e_min, e_max;
};

template <class Real>
SEGSIM_HD inline InverseDepthRange<Real> inverse_depth_range(const SurfelProjection<Real>& s,
                                                             Real k2, Real near_m) {
  const Real kw = std::sqrt(k2 * (s.w0 * s.w0 + s.w1 * s.w1));
  const Real nearest = larger(Real(1) - kw, near_m / s.z0_m);
  return {Real(1) / (Real(1) + kw), Real(1) / nearest};
}

/// Can 2 |d|^2 fall below rho anywhere on the surfel? Only if the smaller axis of its image is
/// thinner than the low pass, allowing for perspective.
template <class Real>
SEGSIM_HD inline bool low_pass_matters(const SurfelProjection<Real>& s, Real k2) {
  const Real kw1 = Real(1) + std::sqrt(k2 * (s.w0 * s.w0 + s.w1 * s.w1));
  const Real t = Real(0.501) * kw1 * kw1;
  const Real det = s.a0 * s.b1 - s.a1 * s.b0;
  const Real trace = s.a0 * s.a0 + s.a1 * s.a1 + s.b0 * s.b0 + s.b1 * s.b1;
  return det * det < t * (trace - t) || trace < t + t;
}

/// Constant of the spherical harmonics of degree 1.
inline constexpr double kShC1 = 0.4886025119029199;

/// Real spherical harmonics up to degree 3 in the order and with the signs of the 3DGS files.
/// @param direction  Unit, from the camera to the surfel, world frame.
/// @param basis  Receives (degree + 1)^2 values.
template <class Real>
SEGSIM_HD inline void sh_basis(int degree, const Vec3<Real>& direction, Real* basis) {
  const Real x = direction.x, y = direction.y, z = direction.z;
  basis[0] = Real(0.28209479177387814);
  if (degree < 1) return;
  basis[1] = Real(-kShC1) * y;
  basis[2] = Real(kShC1) * z;
  basis[3] = Real(-kShC1) * x;
  if (degree < 2) return;
  constexpr double kC2 = 1.0925484305920792;
  const Real xx = x * x, yy = y * y, zz = z * z;
  basis[4] = Real(kC2) * x * y;
  basis[5] = Real(-kC2) * y * z;
  basis[6] = Real(0.31539156525252005) * (Real(2) * zz - xx - yy);
  basis[7] = Real(-kC2) * x * z;
  basis[8] = Real(0.5462742152960396) * (xx - yy);
  if (degree < 3) return;
  basis[9] = Real(-0.5900435899266435) * y * (Real(3) * xx - yy);
  basis[10] = Real(2.890611442640554) * x * y * z;
  basis[11] = Real(-0.4570457994644658) * y * (Real(4) * zz - xx - yy);
  basis[12] = Real(0.3731763325901154) * z * (Real(2) * zz - Real(3) * xx - Real(3) * yy);
  basis[13] = Real(-0.4570457994644658) * x * (Real(4) * zz - xx - yy);
  basis[14] = Real(1.445305721320277) * z * (xx - yy);
  basis[15] = Real(-0.5900435899266435) * x * (xx - Real(3) * yy);
}

}  // namespace segsim::renderer
