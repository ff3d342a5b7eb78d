#pragma once

/// @file
/// Derivative of the spherical harmonics of surfel_geometry.h by the direction.

#include "core/host_device.h"
#include "renderer/scene/surfel_geometry.h"

namespace segsim::reconstruction {

/// @param direction  Unit; the basis is differentiated as the polynomials that sh_basis()
///     evaluates, so the caller projects out what changes the length.
/// @param by_basis  Derivatives of the loss by the (degree + 1)^2 values.
template <class Real>
SEGSIM_HD inline renderer::Vec3<Real> sh_basis_adjoint(int degree,
                                                       const renderer::Vec3<Real>& direction,
                                                       const Real* by_basis) {
  renderer::Vec3<Real> by{Real(0), Real(0), Real(0)};
  if (degree < 1) return by;
  const Real x = direction.x, y = direction.y, z = direction.z;
  constexpr double kC1 = 0.4886025119029199;
  by.y -= Real(kC1) * by_basis[1];
  by.z += Real(kC1) * by_basis[2];
  by.x -= Real(kC1) * by_basis[3];
  if (degree < 2) return by;
  constexpr double kC2 = 1.0925484305920792;
  const Real b4 = Real(kC2) * by_basis[4], b5 = Real(-kC2) * by_basis[5];
  const Real b6 = Real(2 * 0.31539156525252005) * by_basis[6];
  const Real b7 = Real(-kC2) * by_basis[7], b8 = Real(2 * 0.5462742152960396) * by_basis[8];
  by.x += b4 * y - b6 * x + b7 * z + b8 * x;
  by.y += b4 * x + b5 * z - b6 * y - b8 * y;
  by.z += b5 * y + Real(2) * b6 * z + b7 * x;
  if (degree < 3) return by;
  const Real xx = x * x, yy = y * y, zz = z * z, xy = x * y, xz = x * z, yz = y * z;
  const Real b9 = Real(-0.5900435899266435) * by_basis[9];
  const Real b10 = Real(2.890611442640554) * by_basis[10];
  const Real b11 = Real(-0.4570457994644658) * by_basis[11];
  const Real b12 = Real(0.3731763325901154) * by_basis[12];
  const Real b13 = Real(-0.4570457994644658) * by_basis[13];
  const Real b14 = Real(1.445305721320277) * by_basis[14];
  const Real b15 = Real(-0.5900435899266435) * by_basis[15];
  by.x += b9 * Real(6) * xy + b10 * yz - b11 * Real(2) * xy - b12 * Real(6) * xz +
          b13 * (Real(4) * zz - Real(3) * xx - yy) + b14 * Real(2) * xz +
          b15 * Real(3) * (xx - yy);
  by.y += b9 * Real(3) * (xx - yy) + b10 * xz + b11 * (Real(4) * zz - xx - Real(3) * yy) -
          b12 * Real(6) * yz - b13 * Real(2) * xy - b14 * Real(2) * yz - b15 * Real(6) * xy;
  by.z += b10 * xy + b11 * Real(8) * yz + b12 * (Real(6) * zz - Real(3) * xx - Real(3) * yy) +
          b13 * Real(8) * xz + b14 * (xx - yy);
  return by;
}

}  // namespace segsim::reconstruction
