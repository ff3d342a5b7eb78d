/// @file
/// meet_surfel() of surfel_adjoint.h for a vector of pixels. Both passes include it, so that
/// they agree bit by bit on who is hit and by how much.
///
/// Included once for every instruction set.

#include <cstdint>

#include "reconstruction/rasterizer/internal/training_tile.h"

#if defined(SEGSIM_RENDERER_TRAINING_TILE_HIT_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SEGSIM_RENDERER_TRAINING_TILE_HIT_INL_H
#undef SEGSIM_RENDERER_TRAINING_TILE_HIT_INL_H
#else
#define SEGSIM_RENDERER_TRAINING_TILE_HIT_INL_H
#endif

#include <hwy/cache_control.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace segsim::reconstruction::internal::training {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::CappedTag<float, kCellSize>;
using Ints = hn::RebindToSigned<Floats>;
using V = hn::Vec<Floats>;
using M = hn::Mask<Floats>;

HWY_INLINE V set(float x) { return hn::Set(Floats(), x); }
HWY_INLINE V load(const float* from) { return hn::Load(Floats(), from); }
HWY_INLINE bool none(M mask) { return hn::AllFalse(Floats(), mask); }

/// 1 / x, correctly rounded, as in the renderer.
HWY_INLINE V inverse_of(V x) { return hn::Div(set(1.0F), x); }

/// e^(-rho / 2) for rho in [0, 20], relative error 3e-7.
HWY_INLINE V gaussian(V rho) {
  const Floats d;
  const Ints di;
  constexpr float kRounder = 12582912.0F;  // 1.5 * 2^23: the sum's low bits are round(t).
  const V t = hn::Mul(rho, set(-0.72134752F));
  const V sum = hn::Add(t, set(kRounder));
  const V x = hn::Sub(t, hn::Sub(sum, set(kRounder)));
  // 2^x for |x| <= 1/2: the series, whose next term is 1.2e-7.
  V y = hn::MulAdd(set(1.5403530e-4F), x, set(1.3333558e-3F));
  y = hn::MulAdd(y, x, set(9.6181291e-3F));
  y = hn::MulAdd(y, x, set(5.5504109e-2F));
  y = hn::MulAdd(y, x, set(2.4022651e-1F));
  y = hn::MulAdd(y, x, set(6.9314718e-1F));
  y = hn::MulAdd(y, x, set(1.0F));
  return hn::BitCast(d, hn::Add(hn::BitCast(di, y), hn::ShiftLeft<23>(hn::BitCast(di, sum))));
}

/// As SurfelHit; numbers of lanes that are not hit mean nothing but are finite.
struct Hits {
  V dx, dy, q0, q1, e;
  V e_drawn, inverse_e;  ///< Of e brought into [e_min, e_max].
  V rho, alpha;
  M hit, low_pass, opaque;
};

/// Pixel centres of a tile, in the order of place_in_tile().
struct PixelCentres {
  alignas(64) float x_px[kRecordPixels], y_px[kRecordPixels];

  PixelCentres(int first_x_px, int first_y_px) {
    for (int y = 0; y < renderer::internal::kTileSizePx; ++y) {
      for (int x = 0; x < renderer::internal::kTileSizePx; ++x) {
        x_px[place_in_tile(x, y)] = static_cast<float>(first_x_px + x) + 0.5F;
        y_px[place_in_tile(x, y)] = static_cast<float>(first_y_px + y) + 0.5F;
      }
    }
  }
};

/// List entries between asking for a surfel and reading it.
inline constexpr std::uint32_t kAhead = 8;

/// Asks for a surfel that a later step reads.
HWY_INLINE void prefetch(const TileView<float>& tile, std::size_t entry) {
  if (entry >= tile.list.size()) return;
  const auto* surfel = reinterpret_cast<const char*>(&tile.surfels[tile.list[entry]]);
  hwy::Prefetch(surfel);
  hwy::Prefetch(surfel + sizeof(ViewSurfel<float>) - 1);
}

HWY_INLINE Hits meet(const DrawnSurfel<float>& s, V x_px, V y_px) {
  Hits h;
  h.dx = hn::Sub(x_px, set(s.x0_px));
  h.dy = hn::Sub(y_px, set(s.y0_px));
  const V dd = hn::MulAdd(h.dx, h.dx, hn::Mul(h.dy, h.dy));
  const V rho_low_pass = hn::Add(dd, dd);
  h.q0 = hn::MulAdd(set(s.m01), h.dy, hn::Mul(set(s.m00), h.dx));
  h.q1 = hn::MulAdd(set(s.m11), h.dy, hn::Mul(set(s.m10), h.dx));
  h.e = hn::NegMulAdd(set(s.g1), h.dy, hn::NegMulAdd(set(s.g0), h.dx, set(1.0F)));
  const V qq = hn::MulAdd(h.q0, h.q0, hn::Mul(h.q1, h.q1));
  const V k2 = set(s.k2);
  const M on_disc =
      hn::And(hn::And(hn::Gt(h.e, hn::Zero(Floats())), hn::Le(h.e, set(s.e_near))),
              hn::Le(qq, hn::Mul(k2, hn::Mul(h.e, h.e))));
  h.hit = hn::Or(on_disc, hn::Le(rho_low_pass, k2));
  h.e_drawn = hn::Min(hn::Max(h.e, set(s.e_min)), set(s.e_max));
  h.inverse_e = inverse_of(h.e_drawn);
  const V rho_disc =
      hn::IfThenElse(on_disc, hn::Mul(qq, hn::Mul(h.inverse_e, h.inverse_e)), set(1e30F));
  h.low_pass = hn::Lt(rho_low_pass, rho_disc);
  h.rho = hn::Min(hn::Min(rho_disc, rho_low_pass), set(20.0F));
  const V alpha = hn::Mul(set(s.opacity), gaussian(h.rho));
  h.opaque = hn::Gt(alpha, set(renderer::kMaxAlpha));
  h.alpha = hn::Min(alpha, set(renderer::kMaxAlpha));
  return h;
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::reconstruction::internal::training
HWY_AFTER_NAMESPACE();

#endif  // per target
