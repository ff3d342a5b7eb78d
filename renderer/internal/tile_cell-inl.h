/// @file
/// Blends the surfels of a chunk into one vector of pixels of a cell. The state lives in
/// registers; three versions of the loop shed what can no longer change:
///
///     some pixel has T > 1/2                  its median depth is still open
///     some pixel has 0.99 T > its K-th weight its Top-K may still change: no later weight
///                                             can exceed 0.99 T
///     else                                    colour, normal and T only
///
/// Included once for every instruction set.

#include <bit>

#include "renderer/internal/compat_rules.h"
#include "renderer/internal/tile_cells.h"
#include "renderer/internal/tile_raster.h"

#if defined(SEGSIM_RENDERER_TILE_CELL_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SEGSIM_RENDERER_TILE_CELL_INL_H
#undef SEGSIM_RENDERER_TILE_CELL_INL_H
#else
#define SEGSIM_RENDERER_TILE_CELL_INL_H
#endif

#include <hwy/highway.h>

#include "renderer/internal/tile_chunk-inl.h"

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer::internal {
namespace HWY_NAMESPACE {

/// Keys that fit in registers; with more of them they stay in memory.
inline constexpr int kRegisterKeys = 4;
/// Surfels between two looks at whether a shorter loop will do.
inline constexpr int kBatch = 8;

/// The values of four rows, repeated for every column of the vector.
HWY_INLINE V rows_of(const float* four_rows, [[maybe_unused]] int lane) {
  const Floats d;
#if HWY_TARGET == HWY_SCALAR
  return hn::Set(d, four_rows[lane % kCellPx]);
#else
  return hn::LoadDup128(d, four_rows);
#endif
}

/// 2^(f p) / 255; where f p > 8.01 or < -100 anything.
HWY_INLINE V alpha_of(V f, V p) {
  const Floats d;
  const Ints di;
  constexpr float kRounder = 12582912.0F;  // 1.5 * 2^23: the sum's low bits are round(f p).
  constexpr float kScale = 1.0F / 255.0F;
  const V sum = hn::MulAdd(f, p, hn::Set(d, kRounder));
  const V whole = hn::Sub(sum, hn::Set(d, kRounder));
  const V x = hn::MulSub(f, p, whole);
  // 2^x / 255 for |x| <= 1/2, relative error 4e-6: degree 4 through the Chebyshev nodes.
  V y = hn::MulAdd(hn::Set(d, 0.00966637F * kScale), x, hn::Set(d, 0.05592198F * kScale));
  y = hn::MulAdd(y, x, hn::Set(d, 0.24022349F * kScale));
  y = hn::MulAdd(y, x, hn::Set(d, 0.69312105F * kScale));
  y = hn::MulAdd(y, x, hn::Set(d, kScale));
  return hn::BitCast(d, hn::Add(hn::BitCast(di, y), hn::ShiftLeft<23>(hn::BitCast(di, sum))));
}

/// Where and how large alpha is: alpha = 2^(f p) / 255.
struct Reach {
  V f, p;
  M hit;
};

/// Pixel positions of the vector: X from the middle of the tile, row from its top.
struct Lanes {
  V x, row;
  int cell_row, first;  ///< First row of the cell; first entry of the vector in the cell.
};

HWY_INLINE Reach reach_with_care(const ScreenSurfel& s, const TilePair& pair, const Lanes& at,
                                 float y_px, M live) {
  const Floats d;
  const V dx = hn::Add(at.x, hn::Set(d, pair.dx));
  const V dy = hn::Add(at.row, hn::Set(d, y_px - s.y0_px));
  const V q_u = hn::MulAdd(hn::Set(d, s.m00), dx, hn::Mul(hn::Set(d, s.m01), dy));
  const V q_v = hn::MulAdd(hn::Set(d, s.m10), dx, hn::Mul(hn::Set(d, s.m11), dy));
  const V e = hn::NegMulAdd(hn::Set(d, s.g0), dx,
                            hn::NegMulAdd(hn::Set(d, s.g1), dy, hn::Set(d, 1.0F)));
  // Outside [e_min, e_max] the plane is nearer than the near plane or beyond the disc, so that
  // only the low pass can hit.
  const M on_disc = hn::And(hn::Ge(e, hn::Set(d, s.e_min)), hn::Le(e, hn::Set(d, s.e_max)));
  const V inverse_e = inverse_of(hn::Max(e, hn::Set(d, s.e_min)));
  const V q2 = hn::MulAdd(q_u, q_u, hn::Mul(q_v, q_v));
  const V c_k2 = hn::Set(d, s.c_k2);
  const V disc =
      hn::Mul(c_k2, hn::NegMulAdd(q2, hn::Mul(inverse_e, inverse_e), hn::Set(d, 1.0F)));
  const V offset2 = hn::MulAdd(dx, dx, hn::Mul(dy, dy));
  const V low_pass = hn::NegMulAdd(offset2, hn::Set(d, kLog2E), c_k2);
  const V exponent = hn::IfThenElse(on_disc, hn::Max(disc, low_pass), low_pass);
  return {exponent, hn::Set(d, 1.0F), hn::And(live, hn::Ge(exponent, hn::Zero(d)))};
}

/// The rules of compat_rules.h: no clamp of e, a low pass with a centre of its own, and either
/// no fragment before the near plane or none dropped.
HWY_INLINE Reach reach_in_compat(const ScreenSurfel& s, const TilePair& pair, const Lanes& at,
                                 float y_px, M live) {
  const Floats d;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.0F);
  const V dx = hn::Add(at.x, hn::Set(d, pair.dx));
  const V dy = hn::Add(at.row, hn::Set(d, y_px - s.y0_px));
  const V q_u = hn::MulAdd(hn::Set(d, s.m00), dx, hn::Mul(hn::Set(d, s.m01), dy));
  const V q_v = hn::MulAdd(hn::Set(d, s.m10), dx, hn::Mul(hn::Set(d, s.m11), dy));
  const V e =
      hn::NegMulAdd(hn::Set(d, s.g0), dx, hn::NegMulAdd(hn::Set(d, s.g1), dy, one));
  M drawn = hn::Ne(e, zero);
  const V inverse_e = hn::Div(one, hn::IfThenElse(drawn, e, one));
  if (s.shape == SurfelShape::kInria) {
    const V nearest = hn::Mul(e, hn::Set(d, kCompatNearM));
    drawn = hn::And(hn::Gt(e, zero), hn::Le(nearest, hn::Set(d, s.z0_m)));
  }
  const V u = hn::Mul(q_u, inverse_e), v = hn::Mul(q_v, inverse_e);
  const V c_k2 = hn::Set(d, s.c_k2);
  const V disc = hn::Mul(c_k2, hn::NegMulAdd(u, u, hn::NegMulAdd(v, v, one)));
  const V x = hn::Sub(dx, hn::Set(d, s.e_min)), y = hn::Sub(dy, hn::Set(d, s.e_max));
  const V low_pass =
      hn::NegMulAdd(hn::MulAdd(x, x, hn::Mul(y, y)), hn::Set(d, kLog2E), c_k2);
  const V exponent = hn::IfThenElse(hn::Gt(disc, low_pass), disc, low_pass);
  return {exponent, one, hn::And(hn::And(live, drawn), hn::Ge(exponent, zero))};
}

HWY_INLINE Reach reach_of(const TileChunk& chunk, std::uint32_t i, const Lanes& at, float y_px,
                          M live) {
  const Floats d;
  const TilePair& pair = chunk.pair[i];
  const V x = at.x;
  const V f =
      hn::MulAdd(hn::MulAdd(hn::Set(d, pair.a), x, rows_of(pair.b + at.cell_row, at.first)), x,
                 rows_of(pair.c + at.cell_row, at.first));
  const V p0 = rows_of(pair.p0 + at.cell_row, at.first);
  if (HWY_LIKELY(pair.kind == PairKind::kPlain)) {
    const V p = hn::MulAdd(hn::MulAdd(rows_of(pair.p2 + at.cell_row, at.first), x,
                                      rows_of(pair.p1 + at.cell_row, at.first)),
                           x, p0);
    return {f, p, hn::And(live, hn::Ge(f, hn::Zero(d)))};
  }
  if (pair.kind == PairKind::kCare) {
    const ScreenSurfel& s = *chunk.screen[i];
    return s.shape > SurfelShape::kCare ? reach_in_compat(s, pair, at, y_px, live)
                                        : reach_with_care(s, pair, at, y_px, live);
  }
  V p;
  if (pair.kind == PairKind::kThinParabola) {
    p = hn::MulAdd(hn::MulAdd(rows_of(pair.p2 + at.cell_row, at.first), x,
                              rows_of(pair.p1 + at.cell_row, at.first)),
                   x, p0);
  } else {
    const V inverse_e = inverse_of(hn::NegMulAdd(hn::Set(d, pair.g0), x, p0));
    p = hn::Mul(hn::Mul(inverse_e, inverse_e), hn::Set(d, pair.c_k2));
  }
  if (pair.kind == PairKind::kExact) return {f, p, hn::And(live, hn::Ge(f, hn::Zero(d)))};
  // Off the disc p may be anything.
  const V low_pass =
      hn::MulAdd(hn::MulAdd(hn::Set(d, -kLog2E), x, hn::Set(d, pair.low_pass_b)), x,
                 rows_of(pair.low_pass_c + at.cell_row, at.first));
  const M on_disc = hn::Ge(f, hn::Zero(d));
  const V exponent = hn::IfThenElse(on_disc, hn::Max(hn::Mul(f, p), low_pass), low_pass);
  return {exponent, hn::Set(d, 1.0F), hn::And(live, hn::Ge(exponent, hn::Zero(d)))};
}

/// Depth of the surfel's plane at the pixels, within the disc's range.
HWY_INLINE V depth_at(const ScreenSurfel& s, const TilePair& pair, const Lanes& at,
                      float y_px) {
  const Floats d;
  const V dx = hn::Add(at.x, hn::Set(d, pair.dx));
  const V dy = hn::Add(at.row, hn::Set(d, y_px - s.y0_px));
  const V e = hn::NegMulAdd(hn::Set(d, s.g0), dx,
                            hn::NegMulAdd(hn::Set(d, s.g1), dy, hn::Set(d, 1.0F)));
  if (s.shape == SurfelShape::kInria) return hn::Div(hn::Set(d, s.z0_m), e);
  if (s.shape == SurfelShape::kGsplat) return hn::Set(d, s.z0_m);
  const V bounded = hn::Min(hn::Max(e, hn::Set(d, s.e_min)), hn::Set(d, s.e_max));
  return hn::Div(hn::Set(d, s.z0_m), bounded);
}

/// A vector of pixels in registers. Keys are compared as floats, whose order for positive
/// numbers is that of their bits: float minima run on more ports.
template <bool kRgb, bool kNormal, int kKeys>
struct Pixels {
  V transmittance, depth, r, g, b, nx, ny, nz;
  M live;
  V key0, key1, key2, key3;  ///< Not an array: they would stay in memory.

  HWY_INLINE void load(const TileState& state, std::size_t p) {
    const Floats d;
    transmittance = hn::Load(d, &state.transmittance[p]);
    depth = hn::Load(d, &state.depth[p]);
    live = hn::Gt(hn::Load(d, &state.live[p]), hn::Zero(d));
    if constexpr (kRgb) {
      r = hn::Load(d, &state.r[p]);
      g = hn::Load(d, &state.g[p]);
      b = hn::Load(d, &state.b[p]);
    }
    if constexpr (kNormal) {
      nx = hn::Load(d, &state.nx[p]);
      ny = hn::Load(d, &state.ny[p]);
      nz = hn::Load(d, &state.nz[p]);
    }
    if constexpr (kKeys == kRegisterKeys) {
      key0 = hn::BitCast(d, hn::Load(Keys(), &state.keys[0][p]));
      key1 = hn::BitCast(d, hn::Load(Keys(), &state.keys[1][p]));
      key2 = hn::BitCast(d, hn::Load(Keys(), &state.keys[2][p]));
      key3 = hn::BitCast(d, hn::Load(Keys(), &state.keys[3][p]));
    }
  }

  HWY_INLINE void store(TileState& state, std::size_t p) const {
    const Floats d;
    hn::Store(transmittance, d, &state.transmittance[p]);
    hn::Store(depth, d, &state.depth[p]);
    hn::Store(hn::IfThenElseZero(live, hn::Set(d, 1.0F)), d, &state.live[p]);
    if constexpr (kRgb) {
      hn::Store(r, d, &state.r[p]);
      hn::Store(g, d, &state.g[p]);
      hn::Store(b, d, &state.b[p]);
    }
    if constexpr (kNormal) {
      hn::Store(nx, d, &state.nx[p]);
      hn::Store(ny, d, &state.ny[p]);
      hn::Store(nz, d, &state.nz[p]);
    }
    if constexpr (kKeys == kRegisterKeys) {
      hn::Store(hn::BitCast(Keys(), key0), Keys(), &state.keys[0][p]);
      hn::Store(hn::BitCast(Keys(), key1), Keys(), &state.keys[1][p]);
      hn::Store(hn::BitCast(Keys(), key2), Keys(), &state.keys[2][p]);
      hn::Store(hn::BitCast(Keys(), key3), Keys(), &state.keys[3][p]);
    }
  }

  [[nodiscard]] HWY_INLINE bool half_open() const {
    const Floats d;
    const V half = hn::Set(d, 1.0F - kMinSurfaceAlpha);
    return !hn::AllFalse(d, hn::And(live, hn::Gt(transmittance, half)));
  }

  /// May a later surfel still enter the Top-K of some pixel?
  [[nodiscard]] HWY_INLINE bool keys_open(const RasterJob& job, const TileState& state,
                                          std::size_t p) const {
    const Floats d;
    V lightest;
    if constexpr (kKeys == kRegisterKeys) {
      lightest = key3;
    } else {
      if (job.all_surfels) return true;
      lightest = hn::BitCast(d, hn::Load(Keys(), &state.keys[job.top_k - 1][p]));
      if (job.first_hits) {
        return !hn::AllFalse(d, hn::And(live, hn::Eq(lightest, hn::Zero(d))));
      }
    }
    const V best_later = hn::Mul(transmittance, hn::Set(d, kMaxAlpha));
    return !hn::AllFalse(d, hn::And(live, hn::Gt(best_later, lightest)));
  }

  /// All surfels count: remembers the pixels that were hit.
  HWY_INLINE static void log_pixels(V weight, M hit, std::uint32_t slot, TileState& state,
                                    std::size_t p) {
    alignas(64) float weights[kCellPixels];
    hn::Store(weight, Floats(), weights);
    for (std::uint64_t bits = bits_of(hit); bits != 0; bits &= bits - 1) {
      const int lane = std::countr_zero(bits);
      accumulate_all(state, row_major(p + static_cast<std::size_t>(lane)), weights[lane],
                     slot);
    }
  }

  HWY_INLINE void insert_key(V weight, M hit, const TileChunk& chunk, std::uint32_t i,
                             const RasterJob& job, TileState& state, std::size_t p) {
    const Floats d;
    const Keys dk;
    if constexpr (kKeys != kRegisterKeys) {
      if (job.all_surfels) {
        log_pixels(weight, hit, chunk.slot[i], state, p);
        return;
      }
    }
    const std::uint32_t position = chunk.window_position + i;
    const auto bits = hn::And(hn::BitCast(dk, weight), hn::Set(dk, ~kKeyPositionMask));
    V key = hn::IfThenElseZero(hit, hn::BitCast(d, hn::Or(bits, hn::Set(dk, position))));
    if constexpr (kKeys == kRegisterKeys) {
      const V after0 = hn::Min(key0, key);
      key0 = hn::Max(key0, key);
      const V after1 = hn::Min(key1, after0);
      key1 = hn::Max(key1, after0);
      const V after2 = hn::Min(key2, after1);
      key2 = hn::Max(key2, after1);
      key3 = hn::Max(key3, after2);
    } else {
      const V lightest = hn::BitCast(d, hn::Load(dk, &state.keys[job.top_k - 1][p]));
      M enters = hn::And(hit, hn::Gt(key, lightest));
      if (job.first_hits) enters = hn::And(enters, hn::Eq(lightest, hn::Zero(d)));
      if (hn::AllFalse(d, enters)) return;
      key = hn::IfThenElseZero(enters, key);
      for (int k = 0; k < job.top_k; ++k) {
        const V present = hn::BitCast(d, hn::Load(dk, &state.keys[k][p]));
        hn::Store(hn::BitCast(dk, hn::Max(present, key)), dk, &state.keys[k][p]);
        key = hn::Min(present, key);
      }
    }
  }

  /// Blends one surfel into the pixels that it hits; finishes those that it would saturate.
  /// @return  Pixels hit.
  template <bool kDepthOpen, bool kKeysOpen>
  HWY_INLINE int blend(const RasterJob& job, const TileChunk& chunk, std::uint32_t i,
                       const Lanes& at, float y_px, TileState& state, std::size_t p) {
    const Floats d;
    const TilePair& pair = chunk.pair[i];
    Reach reach = reach_of(chunk, i, at, y_px, live);
    const std::uint64_t hit_bits = bits_of(reach.hit);
    if (hit_bits == 0) return 0;
    const V alpha = hn::Min(alpha_of(reach.f, reach.p), hn::Set(d, kMaxAlpha));
    V weight = hn::IfThenElseZero(reach.hit, hn::Mul(alpha, transmittance));
    V left = hn::Sub(transmittance, weight);
    const M finished = hn::And(reach.hit, hn::Lt(left, hn::Set(d, job.stop_transmittance)));
    if (HWY_UNLIKELY(!hn::AllFalse(d, finished))) {
      live = hn::AndNot(finished, live);
      reach.hit = hn::AndNot(finished, reach.hit);
      weight = hn::IfThenZeroElse(finished, weight);
      left = hn::IfThenElse(finished, transmittance, left);
    }
    if constexpr (kDepthOpen) {
      if (job.median_depth) {
        const V half = hn::Set(d, 1.0F - kMinSurfaceAlpha);
        const M crossing = hn::And(hn::Gt(transmittance, half), hn::Le(left, half));
        if (!hn::AllFalse(d, crossing)) {
          depth = hn::IfThenElse(crossing, depth_at(*chunk.screen[i], pair, at, y_px), depth);
        }
      } else {
        const V here =
            hn::IfThenElseZero(reach.hit, depth_at(*chunk.screen[i], pair, at, y_px));
        depth = hn::MulAdd(weight, here, depth);
      }
    }
    transmittance = left;
    if constexpr (kRgb) {
      r = hn::MulAdd(weight, hn::Set(d, pair.r), r);
      g = hn::MulAdd(weight, hn::Set(d, pair.g), g);
      b = hn::MulAdd(weight, hn::Set(d, pair.b_colour), b);
    }
    if constexpr (kNormal) {
      nx = hn::MulAdd(weight, hn::Set(d, pair.nx), nx);
      ny = hn::MulAdd(weight, hn::Set(d, pair.ny), ny);
      nz = hn::MulAdd(weight, hn::Set(d, pair.nz), nz);
    }
    if constexpr (kKeysOpen) {
      insert_key(weight, reach.hit, chunk, i, job, state, p);
    }
    return static_cast<int>(std::popcount(hit_bits));
  }
};

/// Up to kBatch surfels of `todo`. @return  Pixels hit.
template <bool kDepthOpen, bool kKeysOpen, class PixelVector>
HWY_INLINE std::uint64_t blend_batch(const RasterJob& job, const TileChunk& chunk,
                                     std::uint64_t& todo, const Lanes& at, float y_px,
                                     PixelVector& pixels, TileState& state, std::size_t p) {
  std::uint64_t contributions = 0;
  for (int n = 0; n < kBatch && todo != 0; ++n) {
    const auto i = static_cast<std::uint32_t>(std::countr_zero(todo));
    todo &= todo - 1;
    contributions += static_cast<std::uint64_t>(
        pixels.template blend<kDepthOpen, kKeysOpen>(job, chunk, i, at, y_px, state, p));
  }
  return contributions;
}

/// Blends the surfels in `todo` (bits of the chunk) into vector `vector` of a cell.
/// @return  False if all its pixels are finished.
template <bool kRgb, bool kNormal, int kKeys>
bool blend_cell(const RasterJob& job, const TileChunk& chunk, std::uint64_t todo, int cell,
                int first, float y_px, TileState& state, TileStats& stats) {
  const Floats d;
  const std::size_t p = static_cast<std::size_t>(cell) * kCellPixels + first;
  Pixels<kRgb, kNormal, kKeys> pixels;
  pixels.load(state, p);
  const Lanes at{hn::Add(hn::Set(d, static_cast<float>(cell / kCellsPerRow * kCellPx) - 7.5F),
                         hn::Load(d, kLaneColumn + first)),
                 hn::Add(hn::Set(d, static_cast<float>(cell % kCellsPerRow * kCellPx) + 0.5F),
                         hn::Load(d, kLaneRow + first)),
                 cell % kCellsPerRow * kCellPx, first};
  bool depth_open = job.wants_depth;
  bool keys_open = kKeys > 0;
  bool any_live = true;
  std::uint64_t contributions = 0;
  stats.evaluations += static_cast<std::uint64_t>(std::popcount(todo)) * hn::Lanes(d);
  while (todo != 0) {
    const bool half_open = pixels.half_open();
    if (job.median_depth) depth_open = depth_open && half_open;
    if constexpr (kKeys > 0) keys_open = keys_open && pixels.keys_open(job, state, p);
    if (job.labels_only && !keys_open && !half_open) {
      pixels.live = hn::Lt(hn::Zero(d), hn::Zero(d));  // None.
    }
    any_live = !hn::AllFalse(d, pixels.live);
    if (!any_live) break;
    if (depth_open) {
      contributions +=
          blend_batch<true, (kKeys > 0)>(job, chunk, todo, at, y_px, pixels, state, p);
    } else if (keys_open) {
      contributions +=
          blend_batch<false, (kKeys > 0)>(job, chunk, todo, at, y_px, pixels, state, p);
    } else {
      contributions += blend_batch<false, false>(job, chunk, todo, at, y_px, pixels, state, p);
    }
  }
  any_live = !hn::AllFalse(d, pixels.live);
  stats.evaluations -= static_cast<std::uint64_t>(std::popcount(todo)) * hn::Lanes(d);
  stats.contributions += contributions;
  pixels.store(state, p);
  return any_live;
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer::internal
HWY_AFTER_NAMESPACE();

#endif  // per target
